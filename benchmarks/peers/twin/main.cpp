// twin INPUT STATES REPEATS KEEP: flies every flight of INPUT one after another, REPEATS times over, prints the seconds
// of processor time per flight of each time, and writes the states [flight, tick, state] of the first KEEP flights to STATES.
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <iostream>

#include "lqr.hpp"

// The last tick that was flown. A flight ends where it leaves its limits, as ours does.
static std::int64_t fly(const Input& in, std::int64_t flight, State& x, std::vector<State>* kept) {
    const double* p = &in.parameters[flight * parameter::count];
    std::copy_n(in.states.begin() + flight * state::count, state::count, x.begin());
    Plant plant(in, p);
    const Numbers& limit = in.limits;
    for (std::int64_t tick = 0;; ++tick) {
        if (kept) kept->push_back(x);
        const Measurement m = measure(x, p);
        const Commands command = lqr(in, m, tick);
        const double alpha = m.alpha - p[parameter::sensor_angle_of_attack_bias];
        const double beta = m.beta - p[parameter::sensor_sideslip_bias];
        const bool inside = x[state::altitude] >= limit[0] && x[state::altitude] <= limit[1] && alpha >= limit[2] &&
                            alpha <= limit[3] && std::abs(beta) <= limit[4];
        if (!inside || tick == in.ticks) return tick;
        for (std::int64_t i = 0; i < in.steps_per_tick; ++i) plant.step(x, command);
    }
}

int main(int count, char** arguments) {
    if (count != 5) {
        std::cerr << "usage: twin INPUT STATES REPEATS KEEP\n";
        return 2;
    }
    try {
        const Input in = read_input(arguments[1]);
        std::ofstream out(arguments[2], std::ios::binary);
        State x;
        for (std::int64_t flight = 0; flight < std::stoll(arguments[4]); ++flight) {
            std::vector<State> kept;
            fly(in, flight, x, &kept);
            out.write(reinterpret_cast<const char*>(kept.data()), static_cast<std::streamsize>(kept.size() * sizeof(State)));
        }
        for (int repeat = 0; repeat < std::stoi(arguments[3]); ++repeat) {
            const std::clock_t start = std::clock();
            std::int64_t ticks = 0;
            for (std::int64_t flight = 0; flight < in.flights; ++flight) ticks += fly(in, flight, x, nullptr);
            const double seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
            if (ticks != in.flights * in.ticks) throw std::runtime_error("a flight ended early");
            std::printf("%.9g\n", seconds / static_cast<double>(in.flights));
        }
    } catch (const std::exception& error) {
        std::cerr << "twin: " << error.what() << '\n';
        return 1;
    }
    return 0;
}
