component fmwear "Milling cut with a hidden wear, for the machine in tests/linuxcnc_watch.py";
description """
wear = (integral of C(V, f)^(1/m) dt)^m, current = idle + k V^bV f^bf wear^bw in the cut, times noise and slow wander:
V in m/min, f in mm/rev, t in min, wear in um, current in A. The values of c0, m and k are those of this edge alone.
""";
pin in float velocity "mm/s, of the path";
pin in float turns "1/s, of the spindle";
pin in float x "mm";
pin in float z "mm, in the workpiece below 1";
pin in bit spindle_on;
pin out float load "A";
pin out float wear "um";
pin out float seconds "in the cut";
pin out float n "1/min";
pin out float fm "mm/min";
pin out bit cutting;
param rw float start = 5 "mm, of the workpiece";
param rw float end = 1e9 "mm";
param rw float D = 10 "mm";
param rw float c0 = 1;
param rw float aV;
param rw float af;
param rw float m = 1;
param rw float k = 1;
param rw float bV;
param rw float bf;
param rw float bw;
param rw float idle = 0.5 "A";
param rw float noise = 0.03 "sd of a reading of the cut, relative";
param rw float sd = 0.02 "of ln load, of the wander";
param rw float tau = 60 "s, of the wander";
param rw u32 seed = 1;
variable double exposure;
variable double wander;
variable unsigned random;
function _ fp;
include <rtapi_math.h>;
license "GPL";
;;

static double normal(unsigned *state) /* of twelve uniform numbers */
{
    double sum = -6.0;
    int i;
    for (i = 0; i < 12; i++) {
        *state = *state * 1664525u + 1013904223u;
        sum += *state / 4294967296.0;
    }
    return sum;
}

FUNCTION(_) {
    double V, f, cut = 0.0;
    if (random == 0) {
        random = seed;
        wander = sd * normal(&random);
    }
    n = turns * 60.0;
    fm = velocity * 60.0;
    V = D * 3.14159265358979 * n / 1000.0;
    f = n > 1.0 ? fm / n : 0.0;
    cutting = x > start && x < end && z < 1.0 && spindle_on && f > 1e-4;
    if (cutting) {
        exposure += pow(c0 * pow(V, aV) * pow(f, af), 1.0 / m) * fperiod / 60.0;
        seconds += fperiod;
        wander += -wander * fperiod / tau + sd * sqrt(2.0 * fperiod / tau) * normal(&random);
        wear = pow(exposure, m);
        cut = k * pow(V, bV) * pow(f, bf) * pow(wear > 1.0 ? wear : 1.0, bw) * exp(wander + noise * normal(&random));
    }
    load = idle * (1.0 + 0.01 * normal(&random)) + cut;
}
