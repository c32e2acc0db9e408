// Earth, atmosphere and rotations: the equations of abhv_mc_vehicle.kernel.world and abhv_mc_vehicle.kernel.numerics.quaternion, with libm.
#pragma once

#include <cmath>

#include "input.hpp"

struct Vector {
    double x, y, z;
};

struct Quaternion {  // scalar first, body to NED
    double w, x, y, z;
};

inline Vector to_ned(const Quaternion& q, const Vector& v) {
    return {(1 - 2 * (q.y * q.y + q.z * q.z)) * v.x + 2 * (q.x * q.y - q.w * q.z) * v.y + 2 * (q.x * q.z + q.w * q.y) * v.z,
            2 * (q.x * q.y + q.w * q.z) * v.x + (1 - 2 * (q.x * q.x + q.z * q.z)) * v.y + 2 * (q.y * q.z - q.w * q.x) * v.z,
            2 * (q.x * q.z - q.w * q.y) * v.x + 2 * (q.y * q.z + q.w * q.x) * v.y + (1 - 2 * (q.x * q.x + q.y * q.y)) * v.z};
}

inline Vector to_body(const Quaternion& q, const Vector& v) {
    return to_ned({q.w, -q.x, -q.y, -q.z}, v);
}

inline double wrap(double angle) {
    if (angle > M_PI) return angle - 2 * M_PI;
    if (angle < -M_PI) return angle + 2 * M_PI;
    return angle;
}

struct Air {
    double density, speed_of_sound;
};

// U.S. Standard Atmosphere 1976 up to 86 km.
inline Air atmosphere(double altitude) {
    constexpr double radius = 6356766.0, gas = 8314.32 / 28.9644, rate = 9.80665 / gas;
    constexpr double base[] = {0, 11e3, 20e3, 32e3, 47e3, 51e3, 71e3, 84852.04584490575};
    constexpr double temperature[] = {288.15, 216.65, 216.65, 228.65, 270.65, 270.65, 214.65, 186.9459083101885};
    constexpr double lapse[] = {-6.5e-3, 0, 1e-3, 2.8e-3, 0, -2.8e-3, -2e-3, 0};
    constexpr double pressure[] = {101325.0,           22632.06397346293, 5474.88866967778,   868.0186847552274,
                                   110.90630555496588, 66.93887311868727, 3.9564204280407287, 0.3733804618310579};
    const double height = radius * altitude / (radius + altitude);
    int i = 0;
    while (i < 7 && height >= base[i + 1]) ++i;
    const double above = height - base[i];
    const double t = temperature[i] + lapse[i] * above;
    const double p = pressure[i] * (lapse[i] != 0 ? std::pow(t / temperature[i], -rate / lapse[i])
                                                  : std::exp(-rate * above / temperature[i]));
    return {p / (gas * t), std::sqrt(1.4 * gas * t)};
}

struct Radii {
    double meridian, vertical;
};

inline Radii radii(const Numbers& e, double sin_lat) {
    const double e2 = e[earth::flattening] * (2 - e[earth::flattening]);
    const double w2 = 1 - e2 * sin_lat * sin_lat;
    const double vertical = e[earth::equatorial_radius] / std::sqrt(w2);
    return {vertical * (1 - e2) / w2, vertical};
}

// Central and J2 attraction and the centrifugal acceleration, north-east-down.
inline Vector gravity(const Numbers& e, double vertical, double altitude, double sin_lat, double cos_lat) {
    const double e2 = e[earth::flattening] * (2 - e[earth::flattening]);
    const double rho = (vertical + altitude) * cos_lat;
    const double z = (vertical * (1 - e2) + altitude) * sin_lat;
    const double inverse = 1 / (rho * rho + z * z);
    const double central = e[earth::gravitational_parameter] * inverse * std::sqrt(inverse);
    const double a = e[earth::equatorial_radius], rotation = e[earth::rotation_rate];
    const double j2 = 1.5 * e[earth::j2] * a * a * inverse;
    const double tilt = 5 * z * z * inverse;
    const double g_rho = (rotation * rotation - central * (1 + j2 * (1 - tilt))) * rho;
    const double g_z = -central * (1 + j2 * (3 - tilt)) * z;
    return {g_z * cos_lat - g_rho * sin_lat, 0, -(g_rho * cos_lat + g_z * sin_lat)};
}
