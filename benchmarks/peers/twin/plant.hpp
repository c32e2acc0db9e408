// Build-up and the 22 equations of motion: abhv_mc_vehicle.plant, one flight at a time.
#pragma once

#include "tables.hpp"
#include "world.hpp"

using State = std::array<double, state::count>;
using Commands = std::array<double, 4>;  // aileron, rudder, elevator, equivalence ratio

struct Flow {
    double speed, sin_a, cos_a, sin_b, cos_b, alpha, beta;
};

inline Flow flow_of(const Vector& v) {
    const double in_plane = std::sqrt(v.x * v.x + v.z * v.z);
    const double speed = std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z);
    return {speed,          v.z / in_plane,         v.x / in_plane, v.y / speed, in_plane / speed,
            std::atan2(v.z, v.x), std::atan2(v.y, in_plane)};
}

inline Quaternion attitude_of(const State& x) { return {x[state::q0], x[state::q1], x[state::q2], x[state::q3]}; }

class Plant {
public:
    Plant(const Input& in, const double* dispersions) : in_(in), p_(dispersions), tables_(in.tables), actuators_{surface(), surface(), surface(), engine()} {}

    State derivative(const State& x) {
        using namespace constants;
        const Numbers& c = in_.constants;
        const Quaternion q = attitude_of(x);
        const double altitude = x[state::altitude];
        const double sin_lat = std::sin(x[state::latitude]), cos_lat = std::cos(x[state::latitude]);
        const double rotation = in_.earth[earth::rotation_rate];
        const Vector turn = to_body(q, {rotation * cos_lat, 0, -rotation * sin_lat});
        const Vector velocity{x[state::u], x[state::v], x[state::w]};
        const Vector rate{x[state::roll_rate], x[state::pitch_rate], x[state::yaw_rate]};

        // Air data and the variables of the tables.
        const Vector wind = to_body(q, {p_[parameter::wind_north] + p_[parameter::wind_shear_north] * altitude,
                                        p_[parameter::wind_east] + p_[parameter::wind_shear_east] * altitude, 0});
        const Flow flow = flow_of({velocity.x - wind.x, velocity.y - wind.y, velocity.z - wind.z});
        const Air air = atmosphere(altitude);
        const double rho = air.density * p_[parameter::atmosphere_density];
        const double q_bar = 0.5 * rho * flow.speed * flow.speed;
        const double half = 0.5 / flow.speed;
        Variables& v = variables_;
        v[variable::one] = 1;
        v[variable::mach] = flow.speed / air.speed_of_sound;
        v[variable::angle_of_attack] = flow.alpha;
        v[variable::sideslip] = flow.beta;
        v[variable::roll_rate_hat] = (rate.x - turn.x) * c[span] * half;
        v[variable::pitch_rate_hat] = (rate.y - turn.y) * c[chord] * half;
        v[variable::yaw_rate_hat] = (rate.z - turn.z) * c[span] * half;
        const double* gain = p_ + parameter::control_aileron_effectiveness;  // aileron, rudder, elevator
        for (int i = 0; i < 3; ++i) v[variable::aileron + i] = gain[i] * x[state::aileron + i];
        v[variable::equivalence_ratio] = x[state::equivalence_ratio];
        v[variable::altitude] = altitude;
        v[variable::mass] = x[state::mass] / p_[parameter::mass_total];
        for (std::size_t e = 0; e < in_.effector_mix.size() / 3; ++e) {
            const double* mix = &in_.effector_mix[3 * e];
            v[variable::effector_0 + e] =
                mix[0] * v[variable::aileron] + mix[1] * v[variable::rudder] + mix[2] * v[variable::elevator];
        }
        tables_.look_up(v);
        build_up();

        // Forces and moments about the centre of gravity.
        const double lift = p_[parameter::aero_lift] * coefficient_[0] + p_[parameter::aero_lift_increment];
        double drag = p_[parameter::aero_drag] * coefficient_[1] + p_[parameter::aero_drag_increment];
        double side = p_[parameter::aero_side_force] * coefficient_[2];
        if (c[drag_in_wind_axes] > 0) {
            side -= drag * flow.sin_b;
            drag *= flow.cos_b;
        }
        const double q_s = q_bar * c[area];
        const Vector f{q_s * (lift * flow.sin_a - drag * flow.cos_a), q_s * side,
                       q_s * (-lift * flow.cos_a - drag * flow.sin_a)};
        const double isp = fixed(fixed_row::specific_impulse);
        double nominal_thrust = c[capture_thrust] * x[state::equivalence_ratio] * rho * flow.speed *
                                    fixed(fixed_row::capture_area_ratio) * isp +
                                q_bar * fixed(fixed_row::thrust_area);
        if (c[burns_fuel] != 0 && !(x[state::mass] > c[mass_empty] * p_[parameter::mass_total])) nominal_thrust = 0;
        const double thrust = p_[parameter::propulsion_thrust] * nominal_thrust;
        const double fuel = c[standard_gravity] * isp * p_[parameter::propulsion_specific_impulse];
        const double tx = thrust * c[thrust_cos], tz = -thrust * c[thrust_sin];
        const double cg_x = fixed(fixed_row::center_of_gravity_x) + p_[parameter::mass_center_of_gravity_x];
        const double cg_y = p_[parameter::mass_center_of_gravity_y];
        const double cg_z = fixed(fixed_row::center_of_gravity_z) + p_[parameter::mass_center_of_gravity_z];
        const double mx = q_s * c[span] * p_[parameter::aero_rolling_moment] * coefficient_[3] - cg_y * (f.z + tz) + cg_z * f.y;
        const double my = q_s * c[chord] * (p_[parameter::aero_pitching_moment] * coefficient_[4] +
                                            p_[parameter::aero_pitching_moment_increment]) +
                          cg_x * (f.z + tz) - cg_z * f.x + (c[thrust_offset_z] - cg_z) * tx;
        const double mz = q_s * c[span] * p_[parameter::aero_yawing_moment] * coefficient_[5] - cg_x * f.y + cg_y * (f.x + tx);

        // Rotation.
        State d;
        const double ixx = fixed(fixed_row::inertia_xx) * p_[parameter::mass_inertia_xx];
        const double iyy = fixed(fixed_row::inertia_yy) * p_[parameter::mass_inertia_yy];
        const double izz = fixed(fixed_row::inertia_zz) * p_[parameter::mass_inertia_zz];
        const double i13 = fixed(fixed_row::inertia_13) * p_[parameter::mass_inertia_13];
        const double hx = ixx * rate.x + i13 * rate.z, hy = iyy * rate.y, hz = izz * rate.z + i13 * rate.x;
        const double nx = mx - (rate.y * hz - rate.z * hy);
        const double ny = my - (rate.z * hx - rate.x * hz);
        const double nz = mz - (rate.x * hy - rate.y * hx);
        const double inverse = 1 / (ixx * izz - i13 * i13);
        d[state::roll_rate] = (izz * nx - i13 * nz) * inverse;
        d[state::pitch_rate] = ny / iyy;
        d[state::yaw_rate] = (ixx * nz - i13 * nx) * inverse;

        // Translation over the ellipsoid.
        const Radii r = radii(in_.earth, sin_lat);
        const Vector ned = to_ned(q, velocity);
        const Vector g = to_body(q, gravity(in_.earth, r.vertical, altitude, sin_lat, cos_lat));
        const double inverse_mass = 1 / x[state::mass];
        const double a = rate.x + turn.x, b = rate.y + turn.y, w = rate.z + turn.z;
        d[state::u] = (f.x + tx) * inverse_mass + g.x - (b * velocity.z - w * velocity.y);
        d[state::v] = f.y * inverse_mass + g.y - (w * velocity.x - a * velocity.z);
        d[state::w] = (f.z + tz) * inverse_mass + g.z - (a * velocity.y - b * velocity.x);
        const double lat_rate = ned.x / (r.meridian + altitude);
        const double lon_rate = ned.y / ((r.vertical + altitude) * cos_lat);
        d[state::altitude] = -ned.z;
        d[state::latitude] = lat_rate;
        d[state::longitude] = lon_rate;

        // Attitude relative to the local frame, fuel.
        const Vector n = to_body(q, {lon_rate * cos_lat, -lat_rate, -lon_rate * sin_lat});
        const Vector s{rate.x - turn.x - n.x, rate.y - turn.y - n.y, rate.z - turn.z - n.z};
        d[state::q0] = -0.5 * (q.x * s.x + q.y * s.y + q.z * s.z);
        d[state::q1] = 0.5 * (q.w * s.x + q.y * s.z - q.z * s.y);
        d[state::q2] = 0.5 * (q.w * s.y + q.z * s.x - q.x * s.z);
        d[state::q3] = 0.5 * (q.w * s.z + q.x * s.y - q.y * s.x);
        d[state::mass] = fuel > 0 ? -c[burns_fuel] * nominal_thrust / fuel : 0;
        return d;
    }

    // One step of the classical Runge-Kutta method; unit quaternion.
    void step(State& x, const Commands& command) {
        const double h = in_.step;
        std::array<Moved, 4> moved;
        for (int i = 0; i < 4; ++i) moved[i] = actuators_[i].run(x[position[i]], x[rate[i]], command[i]);
        const State k1 = derivative(x);
        State y = x;
        for (int i = 0; i < 4; ++i) y[position[i]] = moved[i].middle;
        for (int i = 0; i < rigid; ++i) y[i] = x[i] + 0.5 * h * k1[i];
        const State k2 = derivative(y);
        for (int i = 0; i < rigid; ++i) y[i] = x[i] + 0.5 * h * k2[i];
        const State k3 = derivative(y);
        for (int i = 0; i < 4; ++i) y[position[i]] = moved[i].end;
        for (int i = 0; i < rigid; ++i) y[i] = x[i] + h * k3[i];
        const State k4 = derivative(y);
        for (int i = 0; i < rigid; ++i) x[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
        for (int i = 0; i < 4; ++i) x[position[i]] = moved[i].end, x[rate[i]] = moved[i].rate;
        const Quaternion q = attitude_of(x);
        const double norm = 1 / std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
        for (int i = 0; i < 4; ++i) x[state::q0 + i] *= norm;
    }

private:
    // Aileron, rudder, elevator, engine; the other states go by the integrator.
    static constexpr int position[] = {state::aileron, state::rudder, state::elevator, state::equivalence_ratio};
    static constexpr int rate[] = {state::aileron_rate, state::rudder_rate, state::elevator_rate,
                                   state::equivalence_ratio_rate};
    static constexpr int rigid = state::aileron;

    Actuator surface() const {
        const double* a = in_.actuators.data();  // the axes are alike
        const double limit = a[actuator::high] * p_[parameter::actuator_deflection_limit];
        return {a[actuator::bandwidth] * p_[parameter::actuator_bandwidth],
                a[actuator::damping] * p_[parameter::actuator_damping], -limit, limit,
                a[actuator::rate_limit] * p_[parameter::actuator_rate_limit], in_.step};
    }

    Actuator engine() const {
        const double* a = in_.actuators.data() + 3 * actuator::count;
        return {a[actuator::bandwidth] * p_[parameter::engine_bandwidth],
                a[actuator::damping] * p_[parameter::engine_damping], a[actuator::low],
                a[actuator::high] * p_[parameter::engine_equivalence_ratio_limit],
                a[actuator::rate_limit] * p_[parameter::engine_rate_limit], in_.step};
    }

    double fixed(int row) const { return tables_.row(in_.tables.fixed_row[row]); }

    void build_up() {
        const BuildUp& terms = in_.build_up;
        coefficient_.fill(0);
        for (std::size_t i = 0; i < terms.coefficient.size(); ++i) {
            coefficient_[terms.coefficient[i]] +=
                p_[terms.factor[i]] * tables_.row(terms.table[i]) *
                variables_[terms.variable[i]];
        }
    }

    const Input& in_;
    const double* p_;  // the flight's dispersions, in the order of parameter::
    LookUp tables_;
    std::array<Actuator, 4> actuators_;
    Variables variables_{};
    std::array<double, 6> coefficient_{};
};
