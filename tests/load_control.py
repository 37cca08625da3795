"""What the tests of the C controller share: sequences with faults, the Python reference, C evaluated and compiled."""

import ctypes
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
from c_evaluator import evaluated
from fitmodels.controllers import ConstantLoad

STRICT = ["-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror"]
INPUTS = ("period", "load", "requested", "enable", "spindle_on", "idle", "beat", "reset", "slowed")
OUTPUTS = ("feed_override", "measured", "state", "fault", "worn", "overload", "feed_inhibit")
DRIVER = """\
#include "controller.c"
static LoadState state;
int start(void);
void run(long n, const double *in, double *out);
int start(void) { return load_control_init(&load_settings, &state); }
void run(long n, const double *in, double *out)
{
    for (; n > 0; --n, in += 9, out += 7) {
        LoadInput i;
        LoadOutput o;
        i.period = (LoadReal)in[0];
        i.load = (LoadReal)in[1];
        i.requested = (LoadReal)in[2];
        i.enable = in[3] > 0;
        i.spindle_on = in[4] > 0;
        i.idle = in[5] > 0;
        i.beat = in[6] > 0;
        i.reset = in[7] > 0;
        i.slowed = in[8] > 0;
        load_control_step(&load_settings, &state, &i, &o);
        out[0] = (double)o.feed_override;
        out[1] = (double)o.measured;
        out[2] = (double)o.state;
        out[3] = (double)o.fault;
        out[4] = (double)o.worn;
        out[5] = (double)o.overload;
        out[6] = (double)o.feed_inhibit;
    }
}
"""


def variants(loop):
    """Loops that use every setting of the controller, by name."""
    faster = replace(loop, kp=30.0, ki=20.0, dwell=0.3, form="incremental_sum")
    return {
        "position": loop,
        "stop, feed-forward": replace(loop, stop_on_fault=True, entry_gain=0.5, dwell=0.5),
        "average of the load": replace(loop, average=7),
        "average of the command": replace(loop, average=7, average_of="command", dwell=0.4),
        "incremental sum": faster,
        "incremental sum, average": replace(faster, average=5, average_of="command", entry_gain=-5.0),
        "shortest times": replace(
            loop, filter_time=0.0, stuck_after=0.0, heartbeat=0.0, engage_after=0.0, arm_after=0.0, lost_after=0.0
        ),
        "limits below 1": replace(loop, feed_programmed=1250.0),
    }


def sequence(loop, seed=0, samples=6000):
    """Inputs, shape (samples, 9): period s, load, requested, enable, spindle_on, idle, beat, reset, slowed.

    Stretches of a cut, of air and of each fault in a random order: NaN, infinite, zero, negative, too large, a spike,
    stuck in the cut and in air, a dead source, enable or spindle lost, a cut after the feed was free, invalid and
    other requested feeds, pauses, resets; in a fifth of the samples the feed is slowed from outside.
    """
    rng = np.random.default_rng(seed)
    out = np.empty((samples, len(INPUTS)))
    k = 0
    while k < samples:
        part = out[k : k + int(rng.integers(20, 300))]
        n, kind = len(part), int(rng.integers(0, 16))
        k += n
        level = rng.choice([0.17, 0.2, 0.22, 0.24, 0.27, 0.35], p=[0.1, 0.2, 0.2, 0.2, 0.2, 0.1])
        part[:] = [loop.sample_time, 0.0, loop.feed_programmed, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]
        part[:, 1] = level + rng.normal(0.0, 0.01, n)
        part[:, 6] = np.arange(n) // 3 % 2
        if kind == 0:
            part[n // 2 :, 1] = rng.choice([np.nan, np.inf, -np.inf, 0.0, -1.0, 50.0, 1e30])
        elif kind == 1:
            part[:, 1] = level
        elif kind in (2, 3, 4):
            part[:, 1] = 0.05 + rng.normal(0.0, 0.005, n)
            part[n // 2 :, 5] = 1.0
            part[n // 2 :, 3 + kind % 2] = 0.0
        elif kind == 5:
            part[rng.integers(n), 1] = rng.choice([np.nan, 0.0, 9.0])
        elif kind == 6:
            part[:, 6] = 0.0
        elif kind == 7:
            part[n // 2 :, 3 + rng.integers(2)] = 0.0
        elif kind == 8:
            part[:, 2] = rng.choice([0.0, 0.5, 1.2, 2.0, 3.0]) * loop.feed_programmed
        elif kind == 9:
            part[n // 2, 2] = rng.choice([np.nan, np.inf, -1.0])
        elif kind == 10:
            part[:, 1] = 0.06
        elif kind == 13:
            part[: n // 2, [1, 3, 5]] = [0.05, 0.0, 1.0]
        elif kind == 12:
            part[n // 3 : 2 * n // 3, 5] = 1.0
        elif kind == 11:
            part[n // 3 :, 3] = 0.0
            part[n // 2 : -5, 1] = np.nan
            part[-5:, 3] = 1.0
        if rng.random() < 0.6:
            part[n // 4 : n // 2, 7] = 1.0
    changes = np.repeat(np.random.default_rng([seed, 1]).random(samples // 40 + 1) < 0.2, 40)
    out[:, 8] = changes[:samples]
    return out


def reference(loop, inputs):
    """Outputs of the Python controller, shape (samples, 7), in the order of OUTPUTS."""
    c, out = ConstantLoad(loop), np.empty((len(inputs), len(OUTPUTS)))
    for row, (period, load, requested, *switches) in zip(out, inputs.tolist(), strict=True):
        c.requested = requested
        c.enabled, c.spindle_on, c.idle, c.beat, c.reset, c.slowed = (switch > 0 for switch in switches)
        row[0] = c.step(load, period)
        row[1:] = c._measured, c.state, c.fault, c.worn, c.overload, c.feed_inhibit
    return out


def interpreted(source):
    """A function from inputs to outputs of a C source, evaluated in Python."""
    c = evaluated(source)
    state, inputs, out = (c["new"](name) for name in ("LoadState", "LoadInput", "LoadOutput"))

    def run(rows):
        wrong = c["load_control_init"](c["load_settings"], state)
        if wrong:
            raise ValueError(f"setting {wrong} is out of range")
        found = []
        for row in rows.tolist():
            for name, value in zip(INPUTS, row, strict=True):
                setattr(inputs, name, value)
            c["load_control_step"](c["load_settings"], state, inputs, out)
            found.append([getattr(out, name) for name in OUTPUTS])
        return np.array(found, float)

    return run


def compiled(cc, source, folder, *options):
    """A function from inputs to outputs of the C source, each call from a new state."""
    folder = Path(folder)
    (folder / "controller.c").write_text(source)
    (folder / "driver.c").write_text(DRIVER)
    name = folder / f"driver{len(list(folder.glob('*.so')))}.so"
    subprocess.run([cc, "-shared", "-fPIC", "-O1", *options, folder / "driver.c", "-o", name], check=True)
    library, pointer = ctypes.CDLL(str(name)), ctypes.POINTER(ctypes.c_double)

    def run(inputs):
        inputs, out = np.ascontiguousarray(inputs, float), np.empty((len(inputs), len(OUTPUTS)))
        wrong = library.start()
        if wrong:
            raise ValueError(f"setting {wrong} is out of range")
        library.run(ctypes.c_long(len(inputs)), inputs.ctypes.data_as(pointer), out.ctypes.data_as(pointer))
        return out

    return run
