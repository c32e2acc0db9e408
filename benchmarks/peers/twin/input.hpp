// What the twin flies: the packed vehicle, the Earth, the plan and the dispersions, written by benchmarks/peers/twin.py.
#pragma once

#include <cstdint>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "names.hpp"

using Numbers = std::vector<double>;
using Indices = std::vector<std::int64_t>;

struct Tables {  // as abhv_mc_vehicle.kernel.plant.vehicle.Tables
    Indices axis_variable, axis_start, axis_length;
    Numbers grid, inverse_step;
    Indices group_dimensions, group_axis, group_stride, group_start, group_used, group_row;
    Numbers data;
    Indices fixed_row;
    std::int64_t rows;
};

struct BuildUp {
    Indices coefficient, table, variable, factor;
};

struct Input {
    Numbers constants, actuators, earth;  // in the order of constants:: and earth::; [actuator, actuator::]
    Tables tables;
    BuildUp build_up;
    Numbers effector_mix;  // [effector, 3]
    double step;
    std::int64_t steps_per_tick, ticks;
    Numbers limits, reference, gains, settings;  // [tick, column], [tick, gain]
    Numbers states, parameters;                  // [flight, state], [flight, parameter]
    std::int64_t flights;
};

// Arrays one after another, each behind the count of its values; everything is a double.
class Reader {
public:
    explicit Reader(const std::string& path) : file_(path, std::ios::binary) {
        if (!file_) throw std::runtime_error("cannot read " + path);
    }
    Numbers numbers() {
        std::int64_t count = 0;
        file_.read(reinterpret_cast<char*>(&count), sizeof count);
        Numbers values(count);
        file_.read(reinterpret_cast<char*>(values.data()), count * static_cast<std::int64_t>(sizeof(double)));
        if (!file_) throw std::runtime_error("the input ends too early");
        return values;
    }
    Indices indices() {
        const Numbers values = numbers();
        return Indices(values.begin(), values.end());
    }

private:
    std::ifstream file_;
};

inline Input read_input(const std::string& path) {
    Reader file(path);
    Input in;
    in.constants = file.numbers();
    in.actuators = file.numbers();
    in.earth = file.numbers();
    Tables& t = in.tables;
    t.axis_variable = file.indices();
    t.axis_start = file.indices();
    t.axis_length = file.indices();
    t.grid = file.numbers();
    t.inverse_step = file.numbers();
    t.group_dimensions = file.indices();
    t.group_axis = file.indices();
    t.group_stride = file.indices();
    t.group_start = file.indices();
    t.group_used = file.indices();
    t.group_row = file.indices();
    t.data = file.numbers();
    t.fixed_row = file.indices();
    t.rows = file.indices().at(0);
    in.build_up.coefficient = file.indices();
    in.build_up.table = file.indices();
    in.build_up.variable = file.indices();
    in.build_up.factor = file.indices();
    in.effector_mix = file.numbers();
    const Numbers timing = file.numbers();
    in.step = timing.at(0);
    in.steps_per_tick = static_cast<std::int64_t>(timing.at(1));
    in.ticks = static_cast<std::int64_t>(timing.at(2));
    in.limits = file.numbers();
    in.reference = file.numbers();
    in.gains = file.numbers();
    in.settings = file.numbers();
    in.states = file.numbers();
    in.parameters = file.numbers();
    in.flights = static_cast<std::int64_t>(in.parameters.size()) / parameter::count;
    return in;
}
