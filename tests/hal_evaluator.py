"""An evaluator of HAL text: LinuxCNC's components, nets and threads as the exports use them, in Python.

What halcmd refuses is refused here too: an unknown component, pin, function or thread, a component loaded twice, a
second writer of a signal, a pin on two signals, a value for a pin that a signal drives, a value that is none.
Semantics of the components: man pages of LinuxCNC 2.9, section 9, and traces in halrun (`test_export_hal.py` compares
the two). A component's code runs in the order of ``addf``, once a period; a signal is one value for all its pins.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

Value = bool | int | float


class HalError(ValueError):
    """A line that halcmd does not accept."""


@dataclass(frozen=True)
class Component:
    """Pins with their defaults, whose type is that of the pin, and the code of one call; state is hidden.

    In the code ``{T}`` is the period in s, each other name in braces a pin, a parameter or a state.
    """

    code: str
    inputs: Mapping[str, Value] = field(default_factory=dict)
    outputs: Mapping[str, Value] = field(default_factory=dict)
    both: Mapping[str, Value] = field(default_factory=dict)
    parameters: Mapping[str, Value] = field(default_factory=dict)
    state: Mapping[str, Value] = field(default_factory=dict)
    function: str = ""


def _pins(names: str, default: Value) -> dict[str, Value]:
    return dict.fromkeys(names.split(), default)


_TWO_BITS, _BIT = _pins("in0 in1", False), {"out": False}
_FLOAT = {"out": 0.0}

COMPONENTS: dict[str, Component] = {
    "and2": Component("{out} = {in0} and {in1}", _TWO_BITS, _BIT),
    "or2": Component("{out} = {in0} or {in1}", _TWO_BITS, _BIT),
    "xor2": Component("{out} = {in0} != {in1}", _TWO_BITS, _BIT),
    "not": Component("{out} = not {in}", {"in": False}, _BIT),
    "lut5": Component(
        "{out} = bool({function} >> ({in-0} + 2 * {in-1} + 4 * {in-2} + 8 * {in-3} + 16 * {in-4}) & 1)",
        _pins("in-0 in-1 in-2 in-3 in-4", False), _BIT, parameters={"function": 0},
    ),
    "flipflop": Component(
        """\
if {reset}: {out} = False
elif {set}: {out} = True
elif {clk} and not {old}: {out} = {data}
{out-not} = not {out}
{old} = {clk}""",
        _pins("data clk set reset", False), both=_pins("out out-not", False), state={"old": False},
    ),
    "oneshot": Component(
        """\
if {reset}: {left} = 0.0; {old} = False
else:
    trigger = {in} != {old} and ({rising} if {in} else {falling})
    {old} = {in}
    if {left} > 0:
        trigger = trigger and {retriggerable}
        {left} = max({left} - {T}, 0.0)
    if trigger: {left} = {width}
{out} = {left} > 0
{out-not} = not {out}""",
        {"in": False, "reset": False, "width": 0.0}, _pins("out out-not", False),
        parameters={"retriggerable": True, "rising": True, "falling": False}, state={"left": 0.0, "old": False},
    ),
    "timedelay": Component(
        """\
if {in} != {out}:
    {timer} += {T}
    if {timer} >= ({on-delay} if {in} else {off-delay}): {out} = {in}; {timer} = 0.0
else: {timer} = 0.0""",
        {"in": False, "on-delay": 0.5, "off-delay": 0.5}, _BIT, state={"timer": 0.0},
    ),
    "comp": Component(
        """\
difference = {in1} - {in0}
if difference < -0.5 * {hyst}: {out} = False
elif difference > 0.5 * {hyst}: {out} = True""",
        _pins("in0 in1", 0.0), _BIT, parameters={"hyst": 0.0},
    ),
    "wcomp": Component(
        """\
{under} = {in} <= {min}
{over} = {in} >= {max}
{out} = not ({under} or {over})""",
        _pins("in min max", 0.0), _pins("out under over", False),
    ),
    "near": Component(
        """\
one, two = ({in1}, {in2}) if {in1} >= 0 else (-{in1}, -{in2})
{out} = ({scale} > 1 and one / {scale} <= two <= one * {scale}) or abs(one - two) <= {difference}""",
        _pins("in1 in2", 0.0), _BIT, parameters={"scale": 1.0, "difference": 0.0},
    ),
    "mux2": Component("{out} = {in1} if {sel} else {in0}", {**_pins("in0 in1", 0.0), "sel": False}, _FLOAT),
    "mux4": Component(
        "{out} = ({in3} if {sel0} else {in2}) if {sel1} else ({in1} if {sel0} else {in0})",
        {**_pins("in0 in1 in2 in3", 0.0), **_pins("sel0 sel1", False)}, _FLOAT,
    ),
    "sum2": Component(
        "{out} = {in0} * {gain0} + {in1} * {gain1} + {offset}",
        _pins("in0 in1", 0.0), _FLOAT, parameters={"gain0": 1.0, "gain1": 1.0, "offset": 0.0},
    ),
    "lowpass": Component(
        "{out} = {in} if {load} else {out} + ({in} - {out}) * {gain}",
        {"in": 0.0, "load": False}, _FLOAT, parameters={"gain": 0.0},
    ),
    "ddt": Component("{out} = ({in} - {old}) / {T}\n{old} = {in}", {"in": 0.0}, _FLOAT, state={"old": 0.0}),
    "integ": Component(
        """\
{out} = 0.0 if {reset} else {out} + {gain} * {in} * {T}
{out} = max(min({out}, {max}), {min})""",
        {"in": 0.0, "gain": 1.0, "reset": False, "max": 1e20, "min": -1e20}, _FLOAT,
    ),
    "limit2": Component(
        """\
wanted, step = max(min({in}, {max}), {min}), {maxv} * {T}
{out} = wanted if {load} else max(min(wanted, {out} + step), {out} - step)""",
        {"in": 0.0, "load": False, "min": -1e20, "max": 1e20, "maxv": 1e20}, _FLOAT,
    ),
    "pid": Component(
        """\
{error} = e = ({previous} if {error-previous-target} else {command}) - {feedback}
{previous} = {command}
if {enable}:
    if e * {clipped} <= 0: {sum} += e * {T}
    wanted = {bias} + {Pgain} * e + {Igain} * {sum}
    {clipped} = (wanted > {maxoutput}) - (wanted < -{maxoutput}) if {maxoutput} else 0
    {output} = {clipped} * {maxoutput} if {clipped} else wanted
else: {sum} = 0.0; {clipped} = 0; {output} = 0.0""",
        {**_pins("command feedback bias Pgain Igain Dgain maxoutput", 0.0), "Pgain": 1.0,
         **_pins("enable error-previous-target", False), "error-previous-target": True},
        _pins("error output", 0.0), state={"sum": 0.0, "clipped": 0, "previous": 0.0}, function=".do-pid-calcs",
    ),
    "threads": Component(""),
}  # fmt: skip
MACHINE: dict[str, tuple[str, Value]] = {  # pins that the machine has: direction, value
    "motion.adaptive-feed": ("in", 1.0), "motion.feed-inhibit": ("in", False),
    "motion.in-position": ("out", False), "spindle.0.on": ("out", False),
}  # fmt: skip
_PLACE = re.compile(r"\{([\w-]+)\}")
_BITS = {"TRUE": True, "1": True, "FALSE": False, "0": False}


@dataclass
class _Pin:
    direction: str  # in, out, both, parameter
    cell: int
    signal: str = ""


class Hal:
    """HAL text loaded: signals can be set and read, and `step` runs each thread once.

    Parameters
    ----------
    text : str
    period : float
        s, of the servo thread.

    Raises
    ------
    HalError
        A line that halcmd does not accept.

    Examples
    --------
    >>> hal = Hal("loadrt not names=a\\nnet x a.in\\nnet y a.out\\naddf a servo-thread\\n")
    >>> hal.step()
    >>> hal["y"]
    True
    """

    def __init__(self, text: str, period: float = 0.001) -> None:
        self.cells: list[Value] = []
        self.pins: dict[str, _Pin] = {}
        self.signals: dict[str, int] = {}
        self.threads: dict[str, float] = {"servo-thread": period}
        self.order: dict[str, list[str]] = {"servo-thread": []}
        self._functions: dict[str, tuple[str, Component]] = {}
        self._loaded: set[str] = set()
        for name, (direction, value) in MACHINE.items():
            self._add_pin(name, direction, value)
        for number, line in enumerate(text.splitlines(), 1):
            words = line.split("#", 1)[0].split()
            if words:
                try:
                    self._command(*words)
                except (HalError, TypeError) as error:
                    raise HalError(f"line {number}: {line}: {error}") from None
        self._steps = [self._compiled(thread) for thread in self.threads]

    def __getitem__(self, name: str) -> Value:
        """Value of a signal, or of a pin or parameter."""
        return self.cells[self.signals[name] if name in self.signals else self.pins[name].cell]

    def __setitem__(self, signal: str, value: Value) -> None:
        self.cells[self.signals[signal]] = value

    def step(self) -> None:
        """Run every function once, in the order of its thread."""
        for run in self._steps:
            run(self.cells)

    def trace(self, inputs: Iterable[Mapping[str, Value]], outputs: tuple[str, ...]) -> list[list[Value]]:
        """Signals after each period, for signals set before it."""
        cells, run = self.cells, self.step
        read = [self.signals[name] for name in outputs]
        out = []
        for row in inputs:
            for name, value in row.items():
                cells[self.signals[name]] = value
            run()
            out.append([cells[index] for index in read])
        return out

    def _command(self, name: str, *words: str) -> None:
        commands: dict[str, Callable[..., None]] = {
            "loadrt": self._loadrt, "newsig": self._newsig, "sets": self._sets, "setp": self._setp, "net": self._net,
            "addf": self._addf,
        }  # fmt: skip
        if name not in commands:
            raise HalError("unknown command")
        commands[name](*words)

    def _loadrt(self, kind: str, *options: str) -> None:
        if kind not in COMPONENTS or kind in self._loaded:
            raise HalError(f"{kind} is loaded already" if kind in self._loaded else f"no component {kind}")
        self._loaded.add(kind)
        given = dict(option.split("=", 1) for option in options)
        if kind == "threads":
            self.threads[given["name1"]] = int(given["period1"]) * 1e-9
            self.order[given["name1"]] = []
            return
        for name in given["names"].split(","):
            self._instance(name, COMPONENTS[kind])

    def _instance(self, name: str, component: Component) -> None:
        if name + component.function in self._functions:
            raise HalError(f"{name} exists already")
        groups = (("in", component.inputs), ("out", component.outputs), ("both", component.both),
                  ("parameter", component.parameters), ("state", component.state))  # fmt: skip
        for direction, group in groups:
            for pin, value in group.items():
                self._add_pin(f"{name}.{pin}", direction, value)
        self._functions[name + component.function] = (name, component)

    def _add_pin(self, name: str, direction: str, value: Value) -> None:
        self.pins[name] = _Pin(direction, len(self.cells))
        self.cells.append(value)

    def _pin(self, name: str) -> _Pin:
        if name not in self.pins or self.pins[name].direction == "state":
            raise HalError(f"no pin {name}")
        return self.pins[name]

    def _newsig(self, name: str, kind: str) -> None:
        if name in self.signals:
            raise HalError(f"signal {name} exists already")
        self.signals[name] = len(self.cells)
        self.cells.append({"bit": False, "float": 0.0, "u32": 0}[kind])

    def _sets(self, name: str, value: str) -> None:
        if name not in self.signals or any(p.signal == name and p.direction == "out" for p in self.pins.values()):
            raise HalError(f"{name} is no signal, or has a writer")
        cell = self.signals[name]
        self.cells[cell] = _value(value, self.cells[cell])

    def _setp(self, name: str, value: str) -> None:
        pin = self._pin(name)
        if pin.direction == "out" or pin.signal:
            raise HalError(f"{name} is an output, or on signal {pin.signal}")
        self.cells[pin.cell] = _value(value, self.cells[pin.cell])

    def _net(self, name: str, *words: str) -> None:
        for word in words:
            if word not in ("=>", "<=", "<=>"):
                self._link(name, word, self._pin(word))

    def _link(self, name: str, word: str, pin: _Pin) -> None:
        value = self.cells[pin.cell]
        linked = [each for each in self.pins.values() if each.signal == name]
        if pin.signal or pin.direction == "parameter":
            raise HalError(f"{word} is on signal {pin.signal}, or no pin")
        if pin.direction == "out" and any(each.direction == "out" for each in linked):
            raise HalError(f"signal {name} has a writer already")
        if name not in self.signals:
            self.signals[name] = len(self.cells)
            self.cells.append(value)
        cell = self.signals[name]
        if type(self.cells[cell]) is not type(value):
            raise HalError(f"{word} is not of the type of signal {name}")
        if not linked:
            self.cells[cell] = value
        pin.cell, pin.signal = cell, name

    def _addf(self, function: str, thread: str, position: str = "-1") -> None:
        if function not in self._functions or thread not in self.order:
            raise HalError(f"no function {function} or thread {thread}")
        if any(function in added for added in self.order.values()):
            raise HalError(f"{function} is added already")
        order, at = self.order[thread], int(position)
        order.insert(at - 1 if at > 0 else len(order) + 1 + at, function)

    def _compiled(self, thread: str) -> Callable[[list[Value]], None]:
        """One Python function of a thread's functions in order, the cells as its variables."""
        lines = ["def run(v):", "    pass"]
        for function in self.order[thread]:
            name, component = self._functions[function]
            code = _PLACE.sub(
                lambda place, name=name: self._place(name, place[1], self.threads[thread]), component.code
            )
            lines += ["    " + line for line in code.splitlines()]
        made: dict[str, Callable[[list[Value]], None]] = {}
        exec("\n".join(lines), {}, made)  # noqa: S102  code of the table above
        return made["run"]

    def _place(self, name: str, pin: str, period: float) -> str:
        return repr(period) if pin == "T" else f"v[{self.pins[f'{name}.{pin}'].cell}]"


def _value(word: str, like: Value) -> Value:
    """Value of a word, of the type of a present value."""
    try:
        if isinstance(like, bool):
            return _BITS[word.upper()]
        return int(word, 0) if isinstance(like, int) else float(word)
    except (KeyError, ValueError):
        raise HalError(f"{word} is no value of type {type(like).__name__}") from None
