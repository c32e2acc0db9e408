// Surfaces and engine through a step, ahead of the equations of motion: abhv_mc_vehicle.plant.actuators.
#pragma once

#include <algorithm>
#include <cmath>

#include "names.hpp"

inline double clamp(double x, double low, double high) { return std::min(std::max(x, low), high); }

struct Transition {  // exp(A step), A = [[0, 1], [-stiffness, -friction]], and the first row of its integral
    double e11 = 1, e12 = 0, e21 = 0, e22 = 1, i11 = 1, i12 = 0;

    Transition(double stiffness, double friction, double step) {
        for (int k = 40; k > 0; --k) {
            const double x = step / k, y = step / (k + 1);
            const double j11 = 1 - y * stiffness * i12, j12 = y * (i11 - friction * i12);
            const double f11 = 1 + x * e21, f12 = x * e22;
            const double f21 = -x * (stiffness * e11 + friction * e21), f22 = 1 - x * (stiffness * e12 + friction * e22);
            i11 = j11, i12 = j12, e11 = f11, e12 = f12, e21 = f21, e22 = f22;
        }
        i11 *= step, i12 *= step;
    }
};

struct Moved {
    double middle, end, rate;  // what the stages between feel, and the end of the step
};

class Actuator {
public:
    Actuator(double bandwidth, double damping, double low, double high, double rate_limit, double step)
        : stiffness_(bandwidth * bandwidth), friction_(2 * damping * bandwidth), low_(low), high_(high),
          rate_limit_(rate_limit), step_(step), whole_(stiffness_, friction_, step),
          short_(stiffness_, friction_, step / substeps), cosh_(std::cosh(bandwidth * step)),
          sinh_(bandwidth * std::sinh(bandwidth * step)) {
        middle_error_ = 0.25 * (6 / step * whole_.i11 - 1 - whole_.e11);
        middle_rate_ = 0.25 * (6 / step * whole_.i12 - whole_.e12);
    }

    Moved run(double position, double rate, double command) const {
        const double error = position - command;
        const double reach = cosh_ * std::abs(rate) + sinh_ * std::abs(error), span = step_ * reach;
        if (reach < rate_limit_ && position - span > low_ && position + span < high_) {
            return {command + (middle_error_ * error + middle_rate_ * rate),
                    command + (whole_.e11 * error + whole_.e12 * rate), whole_.e21 * error + whole_.e22 * rate};
        }
        const double start = position;
        double total = 0;
        for (int i = 0; i < substeps; ++i) total += short_step(position, rate, command);
        return {0.25 * (6 / step_ * total - start - position), position, rate};
    }

private:
    static constexpr int substeps = actuators::substeps;

    // Moves position and rate through a short step that may meet the limits; the integral of the position.
    double short_step(double& position, double& rate, double command) const {
        const double h = step_ / substeps, error = position - command;
        double free = short_.e21 * error + short_.e22 * rate;
        const double push = -(stiffness_ * error + friction_ * rate);
        const double outward = rate >= rate_limit_ ? push : (rate <= -rate_limit_ ? -push : 0);
        if (outward > 0 && std::abs(free) < rate_limit_) {
            const double rise = 0.5 * outward * outward / (stiffness_ * rate_limit_);
            free -= rate > 0 ? rise : -rise;
        }
        const double end_rate = clamp(free, -rate_limit_, rate_limit_);
        double moved = command + (short_.e11 * error + short_.e12 * rate);
        if (free != end_rate) {
            const double share = (end_rate - rate) / (free - rate);
            moved = position + h * (end_rate - 0.5 * share * (end_rate - rate));
        }
        const double stop = clamp(moved, low_, high_);
        if (stop == moved) {
            const double smooth = 0.5 * h * (position + moved) + h * h / 12 * (rate - end_rate);
            position = moved, rate = end_rate;
            return smooth;
        }
        const double path = stop - position, share = path / (moved - position), left = h * (1 - share);
        const double pull = stiffness_ * (command - stop);
        const double back = (pull > 0) != (moved > stop) ? pull * left : 0;
        position = stop + 0.5 * left * back, rate = back;
        return h * (stop - 0.5 * share * path);
    }

    double stiffness_, friction_, low_, high_, rate_limit_, step_;
    Transition whole_, short_;
    double cosh_, sinh_, middle_error_, middle_rate_;
};
