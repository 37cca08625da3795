"""Refusals of the gate: single faults of parameter files, each refused, and legitimate files, none refused.

Files are drawn with a load law from noisy runs, a drive of first or second order with delay, PI gains by lambda tuning
with their figures, and settings by the rules of `parameters.settings`, in several units, periods and sizes. Each fault
changes one thing in a drawn file, which is sealed again: its checksum is right. Run: python benchmarks/gate_faults.py
[--files 200] [--seed 1] [--bases 5]
"""

import argparse
import copy
import json
import sys
import time
from collections.abc import Callable

import numpy as np
from fitmodels.controllers.gate import gated_control
from fitmodels.core.errors import FitmodelsError
from fitmodels.parameters import ParameterFile
from fitmodels.parameters.checks.loop_figures import closed_loop, figures
from fitmodels.parameters.file import sealed
from fitmodels.parameters.sections.dynamics import DynamicsSection, PiSection
from pydantic import ValidationError

USABLE = {"level": "usable inside the tested region"}
NOT = {"level": "do not use for control", "reasons": ["The residuals are correlated."]}
NONE = {"kind": "none", "reason": "given"}


def drawn(seed: int) -> dict:
    """Sections of a legitimate file."""
    for attempt in range(100):
        found = _drawn(np.random.default_rng([seed, attempt]))
        if found is not None:
            return found
    raise RuntimeError(f"seed {seed}: no file in 100 attempts")


def _drawn(rng: np.random.Generator) -> dict | None:
    T = float(rng.choice([0.002, 0.005, 0.01, 0.02, 0.04]))
    load, unit_load, size = [("I", "A", 0.28), ("I", "A", 5.0), ("P", "kW", 2.0), ("Fxz", "N", 600.0)][rng.integers(4)]
    unit_feed, per_feed = [("mm/min", 1.0), ("mm/min", 1.0), ("m/min", 1e-3)][rng.integers(3)]
    unit_wear, per_wear = [("mm", 1.0), ("um", 1000.0)][rng.integers(2)]
    safety, worn = float(rng.uniform(0.8, 0.9)), size * float(rng.uniform(0.5, 2.0))
    reference = safety * worn
    truth_upper = per_feed * float(rng.uniform(300, 4000))
    A = reference * float(rng.uniform(0.25, 0.5))
    B = (reference - A) / truth_upper
    k1 = B * truth_upper * float(rng.uniform(0.2, 0.55)) / (0.2 * per_wear)
    law, (A, B, k1) = _law(rng, load, unit_load, unit_feed, unit_wear, (A, B, k1), truth_upper, 0.2 * per_wear)
    upper, lower = (reference - A) / B, (reference - A - 0.2 * per_wear * k1) / B
    programmed = upper * float(rng.choice([1.0, 1.0, 0.95]))
    if not 0.35 * upper < lower < 0.85 * upper:
        return None
    gain = B * float(np.exp(rng.normal(0, 0.12)))
    dynamics, pi = _loop(rng, T, gain, unit_load, unit_feed, per_feed, programmed)
    if pi is None:
        return None
    exact = {"kind": "none", "reason": "drawn"}
    engagement = {"feed_programmed": programmed}
    if rng.random() < 0.5:
        engagement |= {"idle": A * float(rng.uniform(0.9, 1.0)), "engage_after": float(rng.uniform(0.05, 0.3)),
                       "stuck_after": float(rng.uniform(0.5, 2.0)),
                       "load_high": worn * float(rng.uniform(1.5, 6.0))}  # fmt: skip
    if rng.random() < 0.3:
        engagement |= {"on_fault": "stop", "heartbeat": 0.3, "arm_after": float(rng.uniform(0.3, 3.0))}
    return {
        "identity": {
            "tool": "end mill", "work": "S45C", "simulated": True,
            "sensors": [{"symbol": load, "unit": unit_load, "sd": reference * float(rng.uniform(0.0005, 0.006))}],
        },
        "provenance": {"fitmodels": "0.1.0"},
        "laws": {load: law},
        "dynamics": dynamics,
        "pi": pi,
        "load_line": {
            "reference": reference, "worn": worn, "safety_factor": safety, "load": load, "unit_load": unit_load,
            "upper": {"value": upper, "wear": 0.0, "interval": exact},
            "lower": {"value": lower, "wear": 0.2 * per_wear, "interval": exact},
            "unit_feed": unit_feed, "window": [0.18 * per_wear, 0.22 * per_wear], "unit_wear": unit_wear, "law": load,
            "engagement": engagement, **({"dwell": float(rng.uniform(2, 6))} if rng.random() < 0.5 else {}),
        },
        "limits": {"feed_rate": {"low": 0.1 * lower, "high": 3 * upper, "unit": unit_feed}},
    }  # fmt: skip


def _law(rng, load, unit_load, unit_feed, unit_wear, truth, feed, wear):
    """A load line fitted to 30 noisy runs, with its covariance."""
    n, noise = 30, 0.02 * truth[1] * feed
    X = np.column_stack([np.ones(n), rng.uniform(0.4, 1.1, n) * feed, rng.uniform(0.0, 1.1, n) * wear])
    y = X @ np.array(truth) + noise * rng.standard_normal(n)
    scale = np.abs(X).max(axis=0)
    Z = X / scale
    estimate = np.linalg.lstsq(Z, y, rcond=None)[0] / scale
    matrix = noise**2 * np.linalg.inv(Z.T @ Z) / np.outer(scale, scale)
    matrix = (matrix + matrix.T) / 2
    A, B, k1 = (float(value) for value in estimate)
    return {
        "form": "load_line", "response": load, "quantity": "load", "unit": unit_load, "equation": "", "verdict": USABLE,
        "error": "additive", "coefficients": {"A": A, "B": B, "k1": k1},
        "factors": [
            {"symbol": "fm", "quantity": "feed rate", "unit": unit_feed, "low": 0.4 * feed, "high": 1.1 * feed},
            {"symbol": "VB", "quantity": "flank wear", "unit": unit_wear, "low": 0.0, "high": 1.1 * wear},
        ],
        "uncertainty": {"kind": "covariance", "of": ["A", "B", "k1"], "matrix": matrix.tolist(), "df": n - 3},
        "residual_se": noise, "residual_scale": unit_load, "n": n, "df": n - 3,
    }, (A, B, k1)  # fmt: skip


def _loop(rng, T, gain, unit_load, unit_feed, per_feed, programmed):
    """Dynamics and PI gains with their figures; None where the loop is no good one."""
    tau, second = float(rng.uniform(0.05, 0.5)), float(rng.uniform(0.01, 0.05)) * (rng.random() < 0.5)
    nk = int(rng.integers(1, 4))
    unit_u, scaling = [("V", per_feed * float(rng.uniform(100, 2000))), (unit_feed, 1.0), ("%", 1.0)][rng.integers(3)]
    in_loop = "%" if unit_u == "%" else unit_feed
    of_u = gain * (programmed / 100 if unit_u == "%" else scaling)  # unit_load per unit_u of the dynamics

    def polynomials(theta):
        a = np.ones(1)
        for p in theta[1:]:
            a = np.convolve(a, [1.0, -p])
        return np.concatenate([a[1:], [theta[0] * a.sum()]])

    theta = np.array([of_u, np.exp(-T / tau), *([np.exp(-T / second)] if second else [])])
    sd = 0.03 * np.array([of_u, *(1 - theta[1:])])
    found = polynomials(theta)
    J = np.column_stack(
        [(polynomials(theta + h * e) - found) / h for e, h in zip(np.eye(len(theta)), 1e-6 * sd, strict=True)]
    )
    matrix = J @ np.diag(sd**2) @ J.T
    matrix = (matrix + matrix.T) / 2 + np.diag(1e-12 * np.diag(matrix))
    names = [*(f"a{i}" for i in range(1, len(theta))), f"b{nk}"]
    dynamics = {
        "b": [*[0.0] * nk, float(found[-1])], "a": [1.0, *found[:-1].tolist()], "nk": nk, "sample_time": T,
        "unit_u": unit_u, "unit_y": unit_load, "verdict": USABLE,
        "uncertainty": {"kind": "covariance", "of": names, "matrix": matrix.tolist()},
    }  # fmt: skip
    filter_time = float(rng.choice([0.0, 2.0, 4.0])) * T
    K, delay = of_u / (1.0 if unit_u in ("%", unit_feed) else scaling), nk * T + second + filter_time
    closed = max(tau, 3 * delay) * float(rng.uniform(0.8, 2.0))
    kp = tau / (K * (closed + delay))
    ki = kp / min(tau, 4 * (closed + delay))
    pi = {
        "kp": kp, "ki": ki, "sample_time": T, "filter_time": filter_time, "unit_u": in_loop, "unit_y": unit_load,
        "scaling_u": scaling if unit_u == "V" else 1.0, "verdict": USABLE,
    }  # fmt: skip
    loop = closed_loop(DynamicsSection.model_validate(dynamics), PiSection.model_validate(pi))
    if not loop.radius < 1:
        return dynamics, None
    of = figures(loop)
    if of["ms"] > 1.7 or of["settling_time"] > 10:
        return dynamics, None
    names = ("rise_time", "settling_time", "overshoot", "ms", "phase_margin")
    pi["figures"] = {"stable": True, **{name: float(of[name]) for name in names}}
    pi["specification"] = {"rise_time": 1.2 * of["rise_time"], "settling_time": 1.2 * of["settling_time"], "ms": 2.0}
    return dynamics, pi


def sealed_file(sections: dict) -> ParameterFile:
    """The file of sections, with its checksum."""
    return sealed(ParameterFile.model_validate(json.loads(json.dumps(sections))))


# --- single faults: each changes a copy of the sections in place


def times(where: str, *factors: float) -> dict[str, Callable[[dict], None]]:
    def fault(factor):
        def change(s):
            at, key = _at(s, where)
            at[key] = [value * factor for value in at[key]] if isinstance(at[key], list) else at[key] * factor

        return change

    return {f"{where} x {factor:g}": fault(factor) for factor in factors}


def put(where: str, *values) -> dict[str, Callable[[dict], None]]:
    def fault(value):
        def change(s):
            at, key = _at(s, where)
            at[key] = value

        return change

    return {f"{where} = {value if not isinstance(value, dict) else 'do not use'}": fault(value) for value in values}


def drop(where: str) -> dict[str, Callable[[dict], None]]:
    def change(s):
        at, key = _at(s, where)
        del at[key]

    return {f"{where} dropped": change}


def _at(s: dict, where: str):
    *path, last = where.replace("law.", f"laws.{s['load_line']['law']}.").split(".")
    for step in path:
        s = s[int(step)] if isinstance(s, list) else s[step]
    return s, int(last) if isinstance(s, list) else last


def several(name: str, *changes: dict[str, Callable[[dict], None]]) -> dict[str, Callable[[dict], None]]:
    def change(s):
        for one in changes:
            for apply in one.values():
                apply(s)

    return {name: change}


def relative(where: str, of: str, factor: float) -> dict[str, Callable[[dict], None]]:
    """A setting given as a factor of another number of the file."""

    def change(s):
        at, key = _at(s, where)
        source, name = _at(s, of)
        at[key] = source[name] * factor

    return {f"{where} = {factor:g} x {of}": change}


def swap(name: str, one: str, other: str) -> dict[str, Callable[[dict], None]]:
    def change(s):
        (a, i), (b, j) = _at(s, one), _at(s, other)
        a[i], b[j] = b[j], a[i]

    return {name: change}


E = "load_line.engagement."
FAULTS: dict[str, Callable[[dict], None]] = {
    # signs
    **times("dynamics.b", -1), **times("law.coefficients.B", -1), **times("law.coefficients.k1", -1),
    **several("pi.kp and pi.ki x -1", times("pi.kp", -1), times("pi.ki", -1)),
    **several("current sensor reversed: dynamics and gains x -1", times("dynamics.b", -1), times("pi.kp", -1),
              times("pi.ki", -1)),
    **times("load_line.lower.value", -1), **times("load_line.reference", -1),
    # factors of 2.5 and more
    **times("dynamics.b", 2.5, 0.4, 50), **times("pi.scaling_u", 2.5, 0.4, 100), **times("pi.kp", 2.5, 0.4, 100),
    **times("pi.ki", 2.5, 0.4, 100), **times("law.coefficients.A", 2.5, 0.4), **times("law.coefficients.B", 2.5, 0.4),
    **times("law.coefficients.k1", 2.5, 0.4), **times("load_line.reference", 2.5, 0.4),
    **times("load_line.worn", 2.5, 0.4), **times("load_line.safety_factor", 0.4),
    **times("load_line.upper.value", 2.5, 0.4), **put("load_line.upper.value", 1e9),
    **times("load_line.lower.value", 2.5, 0.4), **times("load_line.lower.wear", 2.5, 0.4),
    **several("gains and scaling x 100", times("pi.kp", 100), times("pi.ki", 100), times("pi.scaling_u", 100)),
    **several("gains and scaling x 0.01", times("pi.kp", 0.01), times("pi.ki", 0.01), times("pi.scaling_u", 0.01)),
    **times(E + "feed_programmed", 2.5, 0.2),
    # order of limits
    **swap("feed limits exchanged", "load_line.upper.value", "load_line.lower.value"),
    **times("limits.feed_rate.high", 0.2),
    **swap("window exchanged", "load_line.window.0", "load_line.window.1"),
    **swap("reference and worn exchanged", "load_line.reference", "load_line.worn"),
    **swap("wear of the limits exchanged", "load_line.upper.wear", "load_line.lower.wear"),
    **relative(E + "load_high", "load_line.worn", 0.9), **relative(E + "load_low", "law.coefficients.A", 1.3),
    **put(E + "load_low", 0.0, -1.0),
    **relative(E + "load_low", "law.coefficients.A", 0.05), **relative(E + "load_high", "load_line.worn", 100.0),
    **relative(E + "engage_at", "load_line.reference", 1.1),
    **relative(E + "engage_at", "law.coefficients.A", 0.8), **relative(E + "hysteresis", "load_line.reference", 2.0),
    **relative(E + "idle", "load_line.reference", 1.0),
    # times
    **put(E + "engage_after", 1e9, 10.0), **put(E + "lost_after", 1e9, 5.0), **put(E + "stuck_after", 1e9),
    **put(E + "heartbeat", 1e9), **put(E + "overload_after", 1e9, 30.0), **put(E + "arm_after", 1e9, 10.5),
    **put(E + "back_off", 1e-3), **put(E + "recover", 1e-4, 1e3), **put("load_line.dwell", 1e9, 0.0),
    **times("pi.sample_time", 2.5, 0.4, 1000), **times("dynamics.sample_time", 2.5, 0.4, 0.001),
    **several("both sample times x 1000", times("pi.sample_time", 1000), times("dynamics.sample_time", 1000)),
    **put("pi.filter_time", 30.0), **put("pi.delay", 200), **put("pi.average", 1000),
    **put(E + "sample_time", 1.0, 1e-9),
    # units
    **put("load_line.unit_load", "mm"), **put("load_line.unit_feed", "mm/s", "mm"),
    **put("load_line.unit_wear", "m", "s"),
    **put("law.unit", "m/min"), **put("law.factors.0.unit", "mm/s"), **put("law.factors.1.unit", "inch"),
    **put("pi.unit_u", "mm/s"), **put("pi.unit_y", "m"), **put("dynamics.unit_y", "mm"),
    # dropped sections, and verdicts
    **drop("laws"), **drop("dynamics"), **drop("pi"), **drop("load_line"), **drop("law.verdict"),
    **drop("dynamics.verdict"), **put("law.verdict", NOT), **put("dynamics.verdict", NOT), **put("pi.verdict", NOT),
}  # fmt: skip


# the same in a file that states neither figures nor specification of its gains: the check has nothing to compare
BARE = several("bare", drop("pi.figures"), drop("pi.specification"))
for _name in (
    "dynamics.b x -1", "dynamics.b x 50", "pi.scaling_u x 100", "pi.kp x 100", "pi.ki x 100", "gains and scaling x 100",
    "current sensor reversed: dynamics and gains x -1", "pi.filter_time = 30.0", "pi.average = 1000",
):  # fmt: skip
    FAULTS |= several(f"no figures, {_name}", BARE, {_name: FAULTS[_name]})


def refusal(sections: dict) -> str:
    """First words of the refusal; empty where the file would be exported."""
    try:
        gated_control(sealed_file(sections))
    except ValidationError as error:
        return f"schema: {error.errors()[0]['msg']}"
    except FitmodelsError as error:
        return str(error)
    return ""


def faulty(seed: int, name: str) -> dict:
    """Sections of a drawn file with one fault."""
    sections = copy.deepcopy(drawn(seed))
    FAULTS[name](sections)
    return sections


def main() -> int:
    """Print the refusals, and return 1 where the aims are missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--files", type=int, default=200, help="legitimate files")
    parser.add_argument("--bases", type=int, default=5, help="files that each fault is put into")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    start, refused = time.perf_counter(), 0
    for k in range(args.files):
        if words := refusal(drawn(1000 * args.seed + k)):
            refused += 1
            print(f"legitimate file {1000 * args.seed + k} refused: {words}")
    took = (time.perf_counter() - start) / max(args.files, 1)
    missed = []
    for name in FAULTS:
        found = [refusal(faulty(1000 * args.seed + 500 + base, name)) for base in range(args.bases)]
        missed += [f"{name} in file {1000 * args.seed + 500 + base}" for base, words in enumerate(found) if not words]
        print(f"{name:60.60s} {sum(map(bool, found))}/{len(found)}  {found[0][:110]}")
    for words in missed:
        print(f"NOT refused: {words}")
    print(f"{args.files} legitimate files: {refused} refused, {took:.2f} s each; {len(FAULTS)} faults in {args.bases} "
          f"files each: {len(missed)} not refused")  # fmt: skip
    return int(refused > max(args.files // 200, 1) or bool(missed))


if __name__ == "__main__":
    sys.exit(main())
