component withheld_machine "Machine with errors of unknown size between motor and tool";
description """
Stands in the place of volcomp_plant, with the same pins. Between motor command and tool tip: lost motion of each axis, a
scale error of each axis, one positioning error curve, and the three squareness errors. All sizes are parameters, 0 by
default; tests/linuxcnc/withheld.rs draws them. Formulas of its own, independent of volcomp's model. Units: mm.

Feedback: motor encoders, which do not see these errors. The axis `scale-on` has a linear scale instead, at the driven
side of the lost motion; it sees the lost motion and nothing else. While the drives are off and before homing, every
feedback is the motor's, because LinuxCNC then takes the feedback as its position.
""";
pin in bit on "the drives hold their position while FALSE";
pin in bit homed;
pin in float motor_x "position command of the motor"; pin in float motor_y; pin in float motor_z;
pin out float feedback_x "motor encoder or linear scale"; pin out float feedback_y; pin out float feedback_z;
pin out float drive_x "position of the motor"; pin out float drive_y; pin out float drive_z;
pin out float tool_x "position of the tool tip"; pin out float tool_y; pin out float tool_z;
param rw float play_#[3] "lost motion, mm";
param rw float slope_#[3] "scale error, mm/mm";
param rw float lean_xy "X error per Y travel, mm/mm"; param rw float lean_zx "X error per Z travel"; param rw float lean_yz "Y error per Z travel";
param rw float knot_##[11] "positioning error at -250, -200 .. 250 mm, mm";
param rw s32 curve_on = -1 "axis of the positioning error, 0 to 2; -1: none";
param rw s32 scale_on = -1 "axis with a linear scale; -1: none";
variable double held[3];
variable double carriage[3];
option singleton yes;
function _;
license "MIT OR Apache-2.0";
author "volcomp";
;;
/* Cubic through the knots with central differences as slopes; constant beyond the ends. */
static double curve(const double *k, double at) {
    double place = (at + 250.0) / 50.0;
    if (place <= 0.0) return k[0];
    if (place >= 10.0) return k[10];
    int i = (int)place;
    double u = place - i, left = i > 0 ? k[i - 1] : k[i], right = i < 9 ? k[i + 2] : k[i + 1];
    double m0 = (k[i + 1] - left) / 2.0, m1 = (right - k[i]) / 2.0;
    return k[i] + u * (m0 + u * (3.0 * (k[i + 1] - k[i]) - 2.0 * m0 - m1 + u * (2.0 * (k[i] - k[i + 1]) + m0 + m1)));
}

FUNCTION(_) {
    double motor[3] = { motor_x, motor_y, motor_z }, feedback[3], tip[3], knots[11];
    for (int i = 0; i < 11; i++) knots[i] = knot(i);
    for (int a = 0; a < 3; a++) {
        if (on) held[a] = motor[a];
        double half = play(a) / 2.0;
        if (carriage[a] < held[a] - half) carriage[a] = held[a] - half;
        if (carriage[a] > held[a] + half) carriage[a] = held[a] + half;
        feedback[a] = on && homed && scale_on == a ? carriage[a] : held[a];
        tip[a] = carriage[a] * (1.0 + slope(a));
        if (curve_on == a) tip[a] += curve(knots, carriage[a]);
    }
    tip[0] += lean_xy * carriage[1] + lean_zx * carriage[2];
    tip[1] += lean_yz * carriage[2];
    drive_x = held[0]; drive_y = held[1]; drive_z = held[2];
    feedback_x = feedback[0]; feedback_y = feedback[1]; feedback_z = feedback[2];
    tool_x = tip[0]; tool_y = tip[1]; tool_z = tip[2];
}
