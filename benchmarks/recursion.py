"""Time of the recursion of AC-2017: one tool life, its exact optimum, and a thousand tool lives from draws.

All 16 x 109 pairs in all 15 intervals are computed in full (wear, power, force, MRR): aim 20 ms. Tool life over 1000
draws: aim 1 s. For comparison one tool life is computed in plain loops.

    OMP_NUM_THREADS=1 python benchmarks/recursion.py
"""

import math
import time

from fitmodels import datasets, fit
from fitmodels.controllers.recursion.distribution import life_draws
from fitmodels.controllers.recursion.from_file import life_laws
from fitmodels.controllers.recursion.laws import Rules
from fitmodels.controllers.recursion.life import whole_life
from fitmodels.parameters.draws import Draws
from fitmodels.parameters.published import published

TIMES = 7
DRAWS = 1000


def best_of(run, times: int = TIMES) -> float:
    """Seconds of the fastest of several runs."""
    out = []
    for _ in range(times):
        began = time.perf_counter()
        run()
        out.append(time.perf_counter() - began)
    return min(out)


def in_loops() -> float:
    """Metal removed in one tool life by the flowchart of the paper, over all speeds and feeds, mm3."""
    past, removed, minute = 0.0, 0.0, 0
    while True:
        minute += 1
        best = (0.0, 0.0)
        for i in range(16):
            V = 50.0 + 10.0 * i
            for j in range(109):
                f = round(0.06 + 0.005 * j, 3)
                first = 7.62e-3 * V**0.577 * f**0.168 * 2.5**0.248
                AW = past + first * (minute**0.245 - (minute - 1) ** 0.245)
                P = 0.14 * V**0.82 * f**0.627 * 2.5**0.844 * AW**0.342
                F = 55354 * V**-0.484 * f**0.236 * 2.5**0.715 * AW**1.1
                rate = 2500.0 * V * f
                if AW <= 0.3 and P <= 7.0 and F <= 1500.0 and rate > best[0] + 1e-6:
                    best = rate, AW
        if not best[0]:
            return removed
        removed, past = removed + best[0], best[1]


if __name__ == "__main__":
    laws = life_laws(published("AC-2017"))
    rules = Rules(times="published")
    life = whole_life(laws, rules)
    if not math.isclose(in_loops(), life.removed):
        raise SystemExit("loops and recursion differ")
    grid, exact = best_of(lambda: whole_life(laws, rules)), best_of(lambda: whole_life(laws, rules, how="exact"))
    loops = best_of(in_loops, 2)
    print(f"one tool life, 16 x 109 pairs x 15 intervals: {1e3 * grid:.2f} ms (aim 20); "
          f"in plain loops {1e3 * loops:.0f} ms, {loops / grid:.0f} times as long")  # fmt: skip
    print(f"one tool life, exact optima: {1e3 * exact:.1f} ms")

    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    fits = [fit.power_law(runs, "AW", ["V", "f", "d", "t"])]
    fits += [fit.power_law(runs, name, ["V", "f", "d", "t", "AW"]) for name in ("P", "Fxz")]
    posteriors = [fit.posterior(law, seed=1) for law in fits]
    draws = {post.response: Draws(post.names, post.draws) for post in posteriors}
    for times in ("published", "full"):
        for wear in ("clock", "wear_state"):
            each = Rules(times, wear)
            own = best_of(lambda each=each: life_draws(laws, draws, of="own", rules=each, count=DRAWS), 3)
            plan = best_of(lambda each=each: life_draws(laws, draws, rules=each, count=DRAWS), 3)
            print(f"{DRAWS} draws, {times} times, {wear}: each its own recursion {own:.2f} s (aim 1); "
                  f"one plan on each {1e3 * plan:.1f} ms")  # fmt: skip
