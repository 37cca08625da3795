component fmplant "Cut, tool wear and faults of the machine in tests/linuxcnc_machine.py";
description """
load = A + B G(q)/G(1) feed + k1 VB in the cut and A in air: eq. 14 and 18 of Tai, Tsai & Li 2023,
doi 10.1109/ACCESS.2023.3330587. The feed is the velocity of the path, the drive is sampled each `divide` periods.
""";
pin in float velocity "mm/s, of the path";
pin in float requested "mm/s, the F of the program";
pin in float override "of the operator, 1 is 100 %";
pin in float x "mm";
pin in float z "mm, in the workpiece below 1";
pin in bit spindle_on;
pin out float load "what the controller reads, A";
pin out float current "of the spindle, A";
pin out float wear "um";
pin out float feed "mm/min";
pin out float request "mm/min: program, and operator above 100 %";
pin out float seconds "in the cut";
pin out bit spindle;
pin out bit enable;
pin out bit beat;
pin out bit reset;
pin out bit idle "the path does not advance";
pin out bit cutting;
pin out s32 active "bits of the events in force";
param rw float start = 5 "mm, of the workpiece";
param rw float end = 1e9 "mm";
param rw float A = 0.1;
param rw float B = 1e-4;
param rw float k1 = 1e-4;
param rw float b1;
param rw float b2;
param rw float b3;
param rw float a1;
param rw float a2;
param rw float a3;
param rw s32 divide = 10;
param rw float wear_before = 0 "um";
param rw float wear_rate = 0 "um/s in the cut";
param rw float noise = 0.001 "A, half width of the uniform noise";
pin in s32 event-#[16] "1 value, 2 hold, 3 dead source, 4 spindle-on lost, 5 enable lost, 6 reset, 7 load factor, 8 no heartbeat";
pin in float at-#[16] "s in the cut; below 0: from the first sample";
pin in float until-#[16] "s in the cut";
pin in float value-#[16];
variable double feed1;
variable double feed2;
variable double feed3;
variable double drive1;
variable double drive2;
variable double drive3;
variable long calls;
variable long cut_samples;
variable long beats;
variable long state;
variable double grown;
function _ fp;
include <rtapi_math.h>;
license "GPL";
;;

FUNCTION(_) {
    double reading, drive, factor = 1.0;
    int k, hold = 0, dead = 0, replace = 0, mute = 0;
    double by = 0.0;
    feed = velocity * 60.0;
    request = requested * (override < 1.0 ? 1.0 : override) * 60.0;
    if (calls % divide == 0) {
        drive = b1 * feed1 + b2 * feed2 + b3 * feed3 - a1 * drive1 - a2 * drive2 - a3 * drive3;
        feed3 = feed2; feed2 = feed1; feed1 = feed;
        drive3 = drive2; drive2 = drive1; drive1 = drive;
    }
    calls += 1;
    cutting = x > start && x < end && z < 1.0 && spindle_on;
    if (cutting) {
        cut_samples += 1;
        grown += wear_rate * fperiod;
    } else if (cut_samples > 0) {
        cut_samples += 1;
    }
    wear = wear_before + grown;
    seconds = cut_samples * fperiod;
    spindle = spindle_on;
    enable = 1;
    reset = 0;
    active = 0;
    for (k = 0; k < 16; k++) {
        if (event(k) == 0 || seconds >= until(k)) continue;
        if (at(k) >= 0 && (cut_samples == 0 || seconds < at(k))) continue;
        active |= 1 << k;
        switch (event(k)) {
            case 1: replace = 1; by = value(k); break;
            case 2: hold = 1; break;
            case 3: dead = 1; break;
            case 4: spindle = 0; break;
            case 5: enable = 0; break;
            case 6: reset = 1; break;
            case 7: factor = value(k); break;
            case 8: mute = 1; break;
        }
    }
    current = cutting ? (A + B * drive1 + k1 * wear) * factor : A;
    state = (state * 1103515245L + 12345L) & 0x7fffffffL;
    reading = current + noise * (2.0 * state / 2147483648.0 - 1.0);
    if (replace) reading = by;
    if (!hold && !dead) load = (reading == reading && fabs(reading) < 1e6) ? rint(reading * 1e5) / 1e5 : reading;
    beats += !dead && !mute;
    beat = (beats / 10) % 2;
    idle = velocity * 60.0 < 1.0;
}
