"""Seconds to 4000 effective draws (bulk) of every parameter: our methods, plain emcee, its best move, compiled NUTS.

All in one run on the bundled tests, one thread. Plain emcee is the common use: the stretch move, one call of the log
density per walker, written with numpy. NUTS is that of numpyro where installed, with and without compilation.

    pip install numpyro    # optional
    OMP_NUM_THREADS=1 python benchmarks/posterior.py
"""

import importlib.util
import time

import emcee
import numpy as np
from fitmodels import datasets, fit
from fitmodels.fit.bayes.density import law_density, log_posterior
from fitmodels.fit.bayes.diagnostics import ess_bulk
from fitmodels.fit.bayes.ensemble_sampler import chains
from fitmodels.fit.bayes.exact_draws import exact
from fitmodels.fit.bayes.importance_sampling import find_mode, importance
from fitmodels.fit.bayes.priors import weak

WANTED = 4000
STEPS, BURN = 6000, 0.2
MOVES = {
    "stretch": None,
    "DE": emcee.moves.DEMove(),
    "KDE": emcee.moves.KDEMove(),
    "DE 0.8, snooker 0.2": [(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)],
}


def rate(draws: np.ndarray, seconds: float) -> float:
    """Seconds to WANTED effective draws of the worst parameter, draws (chains, draws, p)."""
    return seconds * WANTED / float(ess_bulk(draws).min())


def best_of(run, times: int = 7) -> float:
    out = []
    for seed in range(times):
        began = time.process_time()
        phi = run(seed)
        out.append(rate(phi.reshape(4, -1, phi.shape[-1]), time.process_time() - began))
    return min(out)


def of_emcee(density, move, steps: int, vectorize: bool) -> float:
    mode, rng = find_mode(density), np.random.RandomState(1)
    walkers = 64 if vectorize else 32
    start = mode.at + rng.standard_normal((walkers, len(mode.at))) @ mode.root.T
    if vectorize:
        sampler = emcee.EnsembleSampler(
            walkers, len(mode.at), lambda x: log_posterior(density, x), vectorize=True, moves=move
        )
    else:
        sampler = emcee.EnsembleSampler(walkers, len(mode.at), lambda x: log_posterior(density, x[None])[0], moves=move)
    sampler.random_state = rng.get_state()
    began = time.process_time()
    sampler.run_mcmc(start, steps)
    took = time.process_time() - began
    return rate(sampler.get_chain()[int(BURN * steps) :].swapaxes(0, 1), took)


def of_chains(density) -> float:
    began = time.process_time()
    sample = chains(density, 1, ess=WANTED)
    took = time.process_time() - began
    return rate(sample.phi.reshape(sample.chains, -1, sample.phi.shape[1]), took)


def of_nuts(law, edges: bool, natural: bool) -> tuple[float, float] | None:
    """Seconds of numpyro's NUTS to WANTED draws with and without compilation, or None where it is not installed."""
    if importlib.util.find_spec("numpyro") is None:
        return None
    import jax
    import jax.numpy as jnp
    import numpyro
    import numpyro.distributions as dist

    jax.config.update("jax_enable_x64", True)
    priors = weak(law, edges)
    density = law_density(law, priors)
    Z, y = jnp.asarray(density.Z), jnp.asarray(density.y)
    edge = jnp.repeat(jnp.arange(len(density.starts)), density.sizes.astype(int)) if edges else None

    def model():
        names = ("level", *law.theta_names[1:])
        beta = jnp.stack([numpyro.sample(n, dist.Normal(priors.of[n].mean, priors.of[n].sd)) for n in names])
        half = dist.FoldedDistribution(dist.StudentT(priors.of["sd"].df, 0.0, priors.of["sd"].scale))
        sd = numpyro.sample("sd", half)
        eta = Z @ beta
        if natural:
            eta = jnp.exp(eta)
        if edges:
            icc = numpyro.sample("icc", dist.Uniform(0, 1))
            z = numpyro.sample("z", dist.Normal(0, 1).expand([len(density.starts)]))
            eta = eta + (sd * jnp.sqrt(icc / (1 - icc)) * z)[edge]
        numpyro.sample("y", dist.Normal(eta, sd), obs=y)

    kernel = numpyro.infer.NUTS(model, init_strategy=numpyro.infer.init_to_median)
    mcmc = numpyro.infer.MCMC(
        kernel, num_warmup=500, num_samples=1500, num_chains=4, chain_method="sequential", progress_bar=False
    )
    began = time.process_time()
    mcmc.run(jax.random.PRNGKey(0))
    first = time.process_time() - began
    began = time.process_time()
    mcmc.run(jax.random.PRNGKey(1))
    second = time.process_time() - began
    found = mcmc.get_samples(group_by_chain=True)
    draws = np.stack([np.asarray(v) for k, v in found.items() if k != "z"], axis=-1)
    return rate(draws, first), rate(draws, second)


def compare(title: str, law, edges: bool, method: str) -> None:
    density, natural = law_density(law, weak(law, edges)), law.error == "additive"
    print(
        f"\n{title}: {law.nobs} rows, {len(density.names)} parameters; seconds to {WANTED} effective draws", flush=True
    )
    ours = exact if method == "exact" else importance
    best = best_of(lambda seed: ours(density, np.random.default_rng(seed), WANTED).phi)
    print(f"  {method:<42}{best:10.4f}")
    engine = of_chains(density)
    print(f"  {'our chains, with convergence checks':<42}{engine:10.3f}")
    plain = of_emcee(density, None, STEPS // 4, vectorize=False)
    print(f"  {'plain emcee (stretch, one call per walker)':<42}{plain:10.3f}")
    moves = {name: of_emcee(density, move, STEPS, vectorize=True) for name, move in MOVES.items()}
    for name, seconds in moves.items():
        print(f"  {'emcee, vectorize=True, ' + name:<42}{seconds:10.3f}")
    least = min(moves.values())
    ratios = [f"best emcee move / {method} {least / best:.0f}", f"plain emcee / our chains {plain / engine:.1f}"]
    nuts = of_nuts(law, edges, natural)
    if nuts is None:
        print("  numpyro is not installed: NUTS not timed")
    else:
        print(
            f"  {'numpyro NUTS with compilation':<42}{nuts[0]:10.3f}\n  {'numpyro NUTS, compiled':<42}{nuts[1]:10.3f}"
        )
        ratios.append(f"compiled NUTS / {method} {nuts[1] / best:.0f}")
    print("  " + ";  ".join(ratios), flush=True)


if __name__ == "__main__":
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    factors = ["V", "f", "d", "t"]
    compare("multiplicative error, independent rows", fit.power_law(runs, "AW", factors, edge=None), False, "exact")
    compare("multiplicative error, random edge levels", fit.power_law(runs, "AW", factors), True, "exact")
    natural = fit.power_law(runs, "AW", factors, error="additive", edge=None)
    compare("additive error, independent rows", natural, False, "importance")
    natural = fit.power_law(runs, "AW", factors, error="additive")
    compare("additive error, random edge levels", natural, True, "importance")
