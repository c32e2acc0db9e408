// The LQR law of abhv_mc_vehicle.control.lqr with the plan's gains of every tick.
#pragma once

#include "plant.hpp"

struct Measurement {
    double altitude, speed, gamma, chi, alpha, beta, bank;
    Vector rate;
};

inline Measurement measure(const State& x, const double* p) {
    const Quaternion q = attitude_of(x);
    const Vector velocity{x[state::u], x[state::v], x[state::w]};
    const Vector ned = to_ned(q, velocity);
    const Flow f = flow_of(velocity);
    const Vector down = to_body(q, {0, 0, 1});
    const double y = -f.cos_a * f.sin_b * down.x + f.cos_b * down.y - f.sin_a * f.sin_b * down.z;
    const double z = -f.sin_a * down.x + f.cos_a * down.z;
    const double* bias = p + parameter::sensor_altitude_bias;  // ten, in the order of the measurement
    return {x[state::altitude] + bias[0],
            f.speed + bias[1],
            std::atan2(-ned.z, std::sqrt(ned.x * ned.x + ned.y * ned.y)) + bias[2],
            std::atan2(ned.y, ned.x) + bias[3],
            f.alpha + bias[4],
            f.beta + bias[5],
            std::atan2(y, z) + bias[6],
            {x[state::roll_rate] + bias[7], x[state::pitch_rate] + bias[8], x[state::yaw_rate] + bias[9]}};
}

inline Commands lqr(const Input& in, const Measurement& m, std::int64_t tick) {
    const double* r = &in.reference[tick * reference::count];
    const double* k = &in.gains[tick * gain::count];
    const Numbers &c = in.constants, &s = in.settings;
    const double error[4] = {m.altitude - r[reference::altitude], m.gamma - r[reference::flight_path_angle],
                             wrap(m.chi - r[reference::heading]), m.speed - r[reference::speed]};
    double u[3] = {0, 0, 0};  // angle of attack, bank, equivalence ratio
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 4; ++j) u[i] += k[gain::guidance + 4 * i + j] * error[j];
    const double alpha_cmd = clamp(r[reference::angle_of_attack] - u[0], s[0], s[1]);
    const double bank_cmd = clamp(r[reference::bank] - u[1], -s[2], s[2]);
    const double eta_cmd = clamp(r[reference::equivalence_ratio] - u[2], c[constants::equivalence_ratio_min],
                                 c[constants::equivalence_ratio_max]);

    const double radius = in.earth[earth::equatorial_radius] + m.altitude;
    const double turn = in.earth[earth::gravitational_parameter] / (radius * radius * m.speed) * std::sin(bank_cmd);
    const double pitch_rate = m.rate.y - turn * std::sin(bank_cmd) / std::cos(bank_cmd);
    const double alpha_err = m.alpha - alpha_cmd;
    const double lateral[4] = {wrap(m.bank - bank_cmd), m.beta, m.rate.x + turn * std::sin(alpha_cmd),
                               m.rate.z - turn * std::cos(alpha_cmd)};
    double surface[2] = {0, 0};  // aileron, rudder
    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 4; ++j) surface[i] -= k[gain::lateral + 4 * i + j] * lateral[j];
    const double elevator = r[reference::elevator] - (k[gain::elevator] * alpha_err + k[gain::elevator + 1] * pitch_rate);
    const double limit = c[constants::surface_limit];
    return {clamp(surface[0], -limit, limit), clamp(surface[1], -limit, limit), clamp(elevator, -limit, limit), eta_cmd};
}
