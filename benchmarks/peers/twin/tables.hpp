// Multilinear look-up of the packed tables: abhv_mc_vehicle.kernel.numerics.tables.
#pragma once

#include <array>

#include "actuators.hpp"
#include "input.hpp"

using Variables = std::array<double, variable::count>;

class LookUp {
public:
    explicit LookUp(const Tables& tables) : t_(tables), cells_(tables.axis_start.size()), rows_(tables.rows) {}

    double row(std::int64_t i) const { return rows_[i]; }

    void look_up(const Variables& x_of) {
        for (std::size_t a = 0; a < cells_.size(); ++a) {  // the search starts from the cell of the last call
            const double* grid = &t_.grid[t_.axis_start[a]];
            const std::int64_t length = t_.axis_length[a];
            const double x = clamp(x_of[t_.axis_variable[a]], grid[0], grid[length - 1]);
            std::int64_t i = cells_[a].index;
            while (i < length - 2 && x >= grid[i + 1]) ++i;
            while (i > 0 && x < grid[i]) --i;
            cells_[a] = {i, (x - grid[i]) * t_.inverse_step[t_.axis_start[a] + i]};
        }
        for (std::size_t g = 0; g < t_.group_start.size(); ++g) {
            const std::int64_t* stride = &t_.group_stride[3 * g];
            const std::int64_t* axis = &t_.group_axis[3 * g];
            const Cell &c0 = cells_[axis[0]], &c1 = cells_[axis[1]];
            const double w00 = (1 - c0.fraction) * (1 - c1.fraction), w10 = c0.fraction * (1 - c1.fraction);
            const double w01 = (1 - c0.fraction) * c1.fraction, w11 = c0.fraction * c1.fraction;
            const double* a = &t_.data[t_.group_start[g] + c0.index * stride[0] + c1.index * stride[1]];
            const double *b = a + stride[0], *c = a + stride[1], *d = b + stride[1];
            double* __restrict out = &rows_[t_.group_row[g]];
            const std::int64_t used = t_.group_used[g];
            if (t_.group_dimensions[g] == 2) {
                for (std::int64_t k = 0; k < used; ++k) out[k] = w00 * a[k] + w10 * b[k] + w01 * c[k] + w11 * d[k];
                continue;
            }
            const Cell& c2 = cells_[axis[2]];
            const std::int64_t low = c2.index * stride[2], high = low + stride[2];
            for (std::int64_t k = 0; k < used; ++k) {
                out[k] = (1 - c2.fraction) * (w00 * a[low + k] + w10 * b[low + k] + w01 * c[low + k] + w11 * d[low + k]) +
                         c2.fraction * (w00 * a[high + k] + w10 * b[high + k] + w01 * c[high + k] + w11 * d[high + k]);
            }
        }
    }

private:
    struct Cell {
        std::int64_t index = 0;
        double fraction = 0;
    };

    const Tables& t_;
    std::vector<Cell> cells_;
    Numbers rows_;
};
