"""Final estimates of candidate structures, and their mixture: the chosen model with weighted alternatives."""

from dataclasses import replace

import numpy as np

from ...core.arrays import Array
from ...core.errors import IdentError
from ...datasets.records.record import Record
from ..estimators.filters import MAX_ORDER
from ..estimators.plant_and_noise import box_jenkins_model, whitened_minimum, whitened_run
from ..estimators.prediction_error import output_error
from ..model import Model
from ..responses.spectra import excited_band
from .candidates import NO_DELAY, Candidate, both_additional, no_model
from .choice import criterion, guard, weights
from .continuous_forms import integrating, refit_form
from .equation_noise import equation_estimate
from .fitted_form import FittedForm
from .structure_search import Search

FINAL, FINAL_STEPS = 1e-10, 100  # predicted reduction of the loss at convergence, as a share; trials
LINEAR, OTHERS = 0.5, 0.25  # weights of the linear part, and of the other structures at the amplitude of the record
MOST_LONG = 3  # candidates estimated on all samples of a record of which parts were searched


def estimated(rec: Record, one: Candidate, additional: Array | None = None) -> Model:
    """Final estimate of a candidate on any record of the machine, started from its coefficients.

    Raises
    ------
    IdentError
        The record does not identify the structure.
    """
    if one.form is not None:
        return form_of(rec, one.form, additional).model
    if one.structure == "arx":
        return equation_estimate(rec, one, additional)
    if one.integrating:
        inner = without_integrator(one)
        return integrating(rec, lambda total, slope: _box_jenkins(total, inner, both_additional(slope, additional)))
    if len(one.d) > MAX_ORDER - 1 and additional is None:
        return _output_error(rec, one)
    return _box_jenkins(rec, one, additional)


def form_of(rec: Record, form: FittedForm, additional: Array | None) -> FittedForm:
    """The form fitted to a record; the given one if it was fitted to this record, by the search."""
    return form if rec.sha256 == form.model.record else refit_form(rec, form, additional=additional)


def _output_error(rec: Record, one: Candidate) -> Model:
    """Output error, where the noise model reaches its largest order: then much of the error is not noise.

    b/a is an approximation, and that with the least simulation error is wanted, not with the least whitened error.
    """
    model = output_error(rec, one.nb, one.na, one.nk, initial="offset")
    return replace(
        model,
        notes=(
            *model.notes,
            f"the error is coloured beyond an autoregression of order {MAX_ORDER - 2}, so it is not noise alone "
            "(nonlinearity, unmodelled dynamics): the model is fitted to the simulation error",
        ),
    )


def _box_jenkins(rec: Record, one: Candidate, additional: Array | None) -> Model:
    """Box-Jenkins estimate from the coefficients of a candidate."""
    run = replace(whitened_run(rec, (one.na, one.nb, one.nk, len(one.d) - 1)), additional=additional)
    if not run.stretches:
        raise IdentError(
            f"no segment of the record is long enough for na {one.na}, nb {one.nb}, nk {one.nk}: record longer."
        )
    end = whitened_minimum(run, np.concatenate([one.theta, one.d[1:]]), FINAL_STEPS, FINAL)
    return box_jenkins_model(rec, run, end)


def without_integrator(one: Candidate) -> Candidate:
    """The candidate from the running sum of the input: a divided by 1 - q^-1."""
    a = np.cumsum(one.a)[:-1]
    return replace(one, na=one.na - 1, theta=np.concatenate([a[1:], one.theta[one.na :]]), integrating=False)


def mixture(rec: Record, found: Search, additional: Array | None = None) -> tuple[Search, Model]:
    """The search with its final estimates, and that of the chosen candidate with the alternatives of the record.

    A candidate whose coefficients are not identifiable is left out.

    Raises
    ------
    IdentError
        No candidate is identifiable.
    """
    models = _estimates(rec, found, additional)
    if len(rec) > found.n:  # compared anew on all samples
        again = sorted(((rescored(rec, one, model), model) for one, model in models), key=lambda pair: pair[0].total)
        shares = weights([one.total for one, _ in again], [one.nk == 0 for one, _ in again])
        models = [(replace(one, weight=float(w)), model) for w, (one, model) in zip(shares, again, strict=True)]
    (chosen, model), *rest = models
    total = chosen.weight + sum(one.weight for one, _ in rest)
    others = tuple((one.weight / total, other) for one, other in rest if one.weight > 0)
    found = found.estimated([one for one, _ in models])
    return found, replace(model, alternatives=others if chosen.weight > 0 else ())


def at_amplitude(rec: Record, linear: Record, found: Search, additional: Array | None = None) -> tuple[Search, Model]:
    """The same as `mixture` of a record with a nonlinearity of the input.

    ``found`` holds the structures of the linear part: its record ``linear`` has the input that acts behind the
    nonlinearity. On the measured input the criterion would select a higher order, which describes the nonlinearity at
    this amplitude in part and is wrong elsewhere. The structures are estimated on the measured input, so that gain and
    delay are those of its amplitude, and the one with the smallest criterion there is chosen. The others and the
    linear part, which the plant approaches at other amplitudes, are its alternatives.
    """
    _, part = mixture(linear, found, additional)
    models = sorted(_estimates(rec, found, additional), key=lambda pair: rescored(rec, *pair).total)
    (_, model), *rest = models
    rest = [(one, other) for one, other in sorted(rest, key=lambda pair: pair[0].total) if one.weight > 0]
    total = sum(one.weight for one, _ in rest)
    others = ((OTHERS * one.weight / total, other) for one, other in rest)
    alternatives = (LINEAR, replace(part, alternatives=())), *others
    return found.estimated([one for one, _ in models]), replace(model, alternatives=alternatives)


def _estimates(rec: Record, found: Search, additional: Array | None) -> list[tuple[Candidate, Model]]:
    """Final estimates of the chosen candidate and of those with a weight; not of those that are not identifiable."""
    models: list[tuple[Candidate, Model]] = []
    refusal: IdentError | None = None
    most = MOST_LONG if len(rec) > found.n else len(found.candidates)
    for one in found.candidates:
        if len(models) == most or (models and one.weight == 0):
            break
        try:
            if one.form is not None:
                one = replace(one, form=form_of(rec, one.form, additional))
            models.append((one, estimated(rec, one, additional)))
        except IdentError as error:
            refusal = refusal or error
    if not models:
        raise refusal or no_model()
    return models


def rescored(rec: Record, one: Candidate, model: Model) -> Candidate:
    """The candidate with criterion and penalty of its final estimate on all samples of a record."""
    n, noise, variance = model.n or 1, len(model.d) - 1, model.noise_variance or 0.0
    own = criterion(n, variance, one.parameters, noise)
    penalty = guard(model.b, model.a, rec.sample_time, excited_band(rec), n) + NO_DELAY * (one.nk == 0)
    return replace(one, theta=model.theta, d=model.d, variance=variance, criterion=own, guard=penalty)
