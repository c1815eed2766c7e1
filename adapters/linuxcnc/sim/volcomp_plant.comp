component volcomp_plant "A machine that is not as it should be: play, screw error and squareness between motor and tool";
description """
Each axis follows its motor with play (lost motion); then the screw and the angles between the axes put the tool beside
where the motor says it is. The feedback is the tool's position, with all errors, as direct scales would show it; while the
drives are off, and before homing, the motor's: there LinuxCNC makes the feedback its position, and the errors would be
gone into it. Units: mm.

The same errors, as a survey would have found them, are in config/examples/linuxcnc/model.toml; the two are written apart.
""";
pin in bit on "the drives hold where they were while this is FALSE";
pin in float motor_x "position command of the motor"; pin in float motor_y; pin in float motor_z;
pin in bit homed;
pin out float feedback_x "what the machine tells of itself"; pin out float feedback_y; pin out float feedback_z;
pin out float drive_x "what it was commanded"; pin out float drive_y; pin out float drive_z;
pin out float tool_x "where the tool really is"; pin out float tool_y; pin out float tool_z;
param rw float play_x = 0.004 "lost motion"; param rw float play_y = 0.003; param rw float play_z = 0.002;
param rw float scale = 1.0 "0 makes the machine perfect";
variable double held_x; variable double held_y; variable double held_z;
variable double nut_x; variable double nut_y; variable double nut_z;
option singleton yes;
function _;
license "MIT OR Apache-2.0";
author "volcomp";
;;
#include <rtapi_math.h>

static double with_play(double nut, double motor, double play) {
    double half = play / 2.0;
    if (nut < motor - half) return motor - half;
    if (nut > motor + half) return motor + half;
    return nut;
}

FUNCTION(_) {
    const double turn = 6.283185307179586;
    if (on) {
        held_x = motor_x;
        held_y = motor_y;
        held_z = motor_z;
    }
    nut_x = with_play(nut_x, held_x, play_x * scale);
    nut_y = with_play(nut_y, held_y, play_y * scale);
    nut_z = with_play(nut_z, held_z, play_z * scale);
    double error_x = 40e-6 * nut_x + 0.006 * sin(turn * nut_x / 80.0) + 0.0015 * sin(turn * nut_x / 20.0 + 0.7);
    double error_y = -60e-6 * nut_y + 0.004 * cos(turn * nut_y / 110.0);
    double error_z = 35e-6 * nut_z;
    /* the Y axis leans towards plus X, the Z axis towards minus X */
    tool_x = nut_x + scale * (error_x + 80e-6 * nut_y - 25e-6 * nut_z);
    tool_y = nut_y + scale * error_y;
    tool_z = nut_z + scale * error_z;
    drive_x = held_x;
    drive_y = held_y;
    drive_z = held_z;
    feedback_x = on && homed ? tool_x : held_x;
    feedback_y = on && homed ? tool_y : held_y;
    feedback_z = on && homed ? tool_z : held_z;
}
