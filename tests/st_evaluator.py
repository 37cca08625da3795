"""An interpreter of the part of IEC 61131-3 structured text that the export uses: one function block, run call by call.

The text is read token by token, parsed by the grammar of IEC 61131-3:2013 (annex A), checked for types, and translated
to Python statements. It is stricter than a controller's compiler: types are never converted implicitly, a name must be
declared, a constant is never assigned, an input is only read, a loop variable stays inside its range, and an operation
whose result the standard leaves to the implementation (MIN or MAX of a number that is not one, a DINT beyond 32 bit, a
division by zero, an index outside an array) is an error.

    block = FunctionBlock(text)
    block.call(LOAD=0.2, ENABLE=True)
    block["FEED_OVERRIDE"]
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

TOKEN: Final = re.compile(
    r"""(?P<space>\s+|\(\*.*?\*\))
    |(?P<real>\d+\.\d+(?:[Ee][+-]?\d+)?)(?![\w.])
    |(?P<integer>\d+)(?![\w])
    |(?P<name>[A-Za-z](?:_?[A-Za-z0-9])*)(?!\w)
    |(?P<sign>:=|<>|<=|>=|\.\.|[-+*/=<>()\[\];:,&])""",
    re.VERBOSE | re.DOTALL,
)
WORDS: Final = {
    "FUNCTION_BLOCK", "END_FUNCTION_BLOCK", "VAR", "VAR_INPUT", "VAR_OUTPUT", "CONSTANT", "END_VAR", "ARRAY", "OF",
    "IF", "THEN", "ELSIF", "ELSE", "END_IF", "FOR", "TO", "DO", "END_FOR", "AND", "OR", "XOR", "NOT", "MOD", "TRUE",
    "FALSE", "BOOL", "DINT", "LREAL",
}  # fmt: skip
DINT_LOW, DINT_HIGH = -(2**31), 2**31 - 1


class GrammarError(Exception):
    """Text that is not in the language."""


class DeclarationError(Exception):
    """A name that is not declared, or an operation on types that it does not take."""


class UndefinedError(Exception):
    """An operation whose result the standard leaves to the implementation."""


@dataclass(frozen=True, slots=True)
class Token:
    """A word, number or sign, with its line."""

    kind: str
    text: str
    line: int


@dataclass(frozen=True, slots=True)
class Variable:
    """A declaration in VAR, VAR_INPUT, VAR_OUTPUT or CONSTANT; ``low`` and ``high`` are the bounds of an array."""

    section: str
    kind: str
    value: Any
    low: int | None = None
    high: int | None = None


@dataclass(frozen=True, slots=True)
class Term:
    """A translated expression and its type."""

    code: str
    kind: str


def tokens(text: str) -> list[Token]:
    """The text without comments; names in capitals, since they have no case (clause 6.1.2)."""
    found, at, line = [], 0, 1
    while at < len(text):
        match = TOKEN.match(text, at)
        if match is None:
            raise GrammarError(f"line {line}: no token begins with {text[at : at + 12]!r}")
        kind, words = str(match.lastgroup), match[0]
        if kind != "space":
            word = words.upper() if kind == "name" else words
            found.append(Token("word" if word in WORDS else kind, word, line))
        elif "(*" in words[2:]:
            raise GrammarError(f"line {line}: a comment inside a comment")
        line, at = line + words.count("\n"), match.end()
    return [*found, Token("end", "the end", line)]


def _minimum(*values: float) -> float:
    return min(_numbers("MIN", values))


def _maximum(*values: float) -> float:
    return max(_numbers("MAX", values))


def _numbers(name: str, values: tuple[float, ...]) -> tuple[float, ...]:
    if any(math.isnan(value) for value in values):
        raise UndefinedError(f"{name} of a value that is not a number")
    return values


def _dint(value: int) -> int:
    if not DINT_LOW <= value <= DINT_HIGH:
        raise UndefinedError(f"{value} does not fit a DINT")
    return value


def _divided(above: float, below: float) -> float:
    if below == 0:
        raise UndefinedError("division by zero")
    return above / below


def _logarithm(value: float) -> float:
    if not value > 0:
        raise UndefinedError(f"logarithm of {value}")
    return math.log(value)


def _place(index: int, low: int, high: int) -> int:
    if not low <= index <= high:
        raise UndefinedError(f"index {index} of an array from {low} to {high}")
    return index - low


RUN: Final[dict[str, Callable[..., Any]]] = {
    "_minimum": _minimum, "_maximum": _maximum, "_dint": _dint, "_divided": _divided, "_place": _place,
    "_abs": abs, "_float": float, "_exp": math.exp, "_ln": _logarithm,
}  # fmt: skip
NUMERIC = ("DINT", "LREAL")
FUNCTIONS: Final = {  # name -> Python function, types it takes, type of the result (None: that of its arguments)
    "ABS": ("_abs", NUMERIC, 1, None), "MIN": ("_minimum", NUMERIC, 2, None), "MAX": ("_maximum", NUMERIC, 2, None),
    "DINT_TO_LREAL": ("_float", ("DINT",), 1, "LREAL"), "EXP": ("_exp", ("LREAL",), 1, None),
    "LN": ("_ln", ("LREAL",), 1, None),
}  # fmt: skip
PRECEDENCE: Final = (
    ("OR",),
    ("XOR",),
    ("AND", "&"),
    ("=", "<>"),
    ("<", ">", "<=", ">="),
    ("+", "-"),
    ("*", "/", "MOD"),
)
PYTHON: Final = {"OR": "or", "XOR": "!=", "AND": "and", "&": "and", "=": "==", "<>": "!="}


@dataclass(slots=True)
class Parser:
    """Recursive descent over the tokens; declares variables and writes Python lines."""

    found: list[Token]
    at: int = 0
    name: str = ""
    variables: dict[str, Variable] = field(default_factory=dict)
    lines: list[str] = field(default_factory=list)
    counted: list[str] = field(default_factory=list)

    @property
    def next(self) -> Token:
        return self.found[self.at]

    def take(self, *texts: str) -> Token:
        """The next token, which must be one of these."""
        token = self.next
        if texts and token.text not in texts:
            raise GrammarError(f"line {token.line}: {token.text!r} where {' or '.join(texts)} belongs")
        self.at += 1
        return token

    def take_kind(self, kind: str) -> Token:
        if self.next.kind != kind:
            raise GrammarError(f"line {self.next.line}: {self.next.text!r} where a {kind} belongs")
        return self.take()

    def fault(self, words: str) -> DeclarationError:
        return DeclarationError(f"line {self.next.line}: {words}")

    # declarations

    def block(self) -> None:
        """FUNCTION_BLOCK name, sections of variables, statements."""
        self.take("FUNCTION_BLOCK")
        self.name = self.take_kind("name").text
        while self.next.text in ("VAR", "VAR_INPUT", "VAR_OUTPUT"):
            section = self.take().text
            if section == "VAR" and self.next.text == "CONSTANT":
                section = self.take().text
            while self.next.text != "END_VAR":
                self.declaration(section)
            self.take("END_VAR")
        self.statements(0, "END_FUNCTION_BLOCK")
        self.take("END_FUNCTION_BLOCK")
        self.take("the end")

    def declaration(self, section: str) -> None:
        name = self.take_kind("name").text
        if name in self.variables or name in FUNCTIONS:
            raise self.fault(f"{name} is declared twice, or is a function")
        self.take(":")
        if self.next.text == "ARRAY":
            self.variables[name] = self.array(section)
        else:
            kind = self.take("BOOL", "DINT", "LREAL").text
            value = {"BOOL": False, "DINT": 0, "LREAL": 0.0}[kind]
            if self.next.text == ":=":
                self.take()
                value = self.literal(kind)
            elif section == "CONSTANT":
                raise self.fault(f"the constant {name} has no value")
            self.variables[name] = Variable(section, kind, value)
        self.take(";")

    def array(self, section: str) -> Variable:
        """``ARRAY[low..high] OF LREAL := [count(value)]``, or the values one by one."""
        self.take("ARRAY")
        self.take("[")
        low = int(self.literal("DINT"))
        self.take("..")
        high = int(self.literal("DINT"))
        self.take("]")
        self.take("OF")
        kind = self.take("LREAL", "DINT").text
        for sign in (":=", "["):
            self.take(sign)
        if self.found[self.at + 1].text == "(":
            count = int(self.literal("DINT"))
            self.take("(")
            values = [self.literal(kind)] * count
            self.take(")")
        else:
            values = [self.literal(kind)]
            while self.next.text == ",":
                self.take()
                values.append(self.literal(kind))
        self.take("]")
        if len(values) != high - low + 1:
            raise self.fault(f"{len(values)} values for an array from {low} to {high}")
        return Variable(section, kind, values, low, high)

    def literal(self, kind: str) -> Any:
        """A value of this type, with its sign."""
        sign = -1 if self.next.text == "-" else 1
        if self.next.text in ("-", "+"):
            self.take()
        token = self.take()
        if kind == "BOOL" and token.text in ("TRUE", "FALSE") and sign == 1:
            return token.text == "TRUE"
        if kind == "DINT" and token.kind == "integer":
            return _dint(sign * int(token.text))
        if kind == "LREAL" and token.kind == "real" and math.isfinite(float(token.text)):
            return sign * float(token.text)
        raise self.fault(f"{token.text!r} is no {kind}")

    # statements

    def statements(self, depth: int, *ends: str) -> None:
        """Statements up to one of the words, which is left."""
        empty = True
        while self.next.text not in ends:
            empty = False
            if self.next.text == "IF":
                self.choice(depth)
            elif self.next.text == "FOR":
                self.loop(depth)
            elif self.next.kind == "name":
                self.assignment(depth)
            else:
                raise GrammarError(f"line {self.next.line}: no statement begins with {self.next.text!r}")
        if empty:
            self.write(depth, "pass")

    def write(self, depth: int, line: str) -> None:
        self.lines.append("    " * depth + line)

    def assignment(self, depth: int) -> None:
        name = self.next.text
        into = self.reference()
        section = self.variables[name].section
        if section in ("CONSTANT", "VAR_INPUT") or name in self.counted:
            raise self.fault(f"{name} is assigned, but it is of {section} or counts a loop")
        self.take(":=")
        value = self.expression()
        if value.kind != into.kind:
            raise self.fault(f"{name} is {into.kind} and is given a {value.kind}")
        self.take(";")
        self.write(depth, f"{into.code} = {value.code}")

    def condition(self) -> str:
        term = self.expression()
        if term.kind != "BOOL":
            raise self.fault(f"a condition is {term.kind}")
        return term.code

    def choice(self, depth: int) -> None:
        word = "if"
        while self.next.text in ("IF", "ELSIF"):
            self.take()
            self.write(depth, f"{word} {self.condition()}:")
            self.take("THEN")
            self.statements(depth + 1, "ELSIF", "ELSE", "END_IF")
            word = "elif"
        if self.next.text == "ELSE":
            self.take()
            self.write(depth, "else:")
            self.statements(depth + 1, "END_IF")
        self.take("END_IF")
        self.take(";")

    def loop(self, depth: int) -> None:
        self.take("FOR")
        name = self.next.text
        into = self.reference()
        self.take(":=")
        first = self.expression()
        self.take("TO")
        last = self.expression()
        if {into.kind, first.kind, last.kind} != {"DINT"}:
            raise self.fault("a loop counts in DINT")
        self.take("DO")
        self.write(depth, f"for {into.code} in range({first.code}, {last.code} + 1):")
        self.counted.append(name)
        self.statements(depth + 1, "END_FOR")
        self.counted.pop()
        self.take("END_FOR")
        self.take(";")

    # expressions

    def expression(self, level: int = 0) -> Term:
        """Binary operators by precedence, each from the left."""
        if level == len(PRECEDENCE):
            return self.unary()
        left = self.expression(level + 1)
        while self.next.text in PRECEDENCE[level] and self.next.kind in ("sign", "word"):
            operator = self.take().text
            left = self.joined(operator, left, self.expression(level + 1))
        return left

    def joined(self, operator: str, left: Term, right: Term) -> Term:
        logical, compares = operator in ("OR", "XOR", "AND", "&"), operator in ("=", "<>", "<", ">", "<=", ">=")
        takes = ("BOOL",) if logical else ("BOOL", *NUMERIC) if operator in ("=", "<>") else NUMERIC
        if left.kind != right.kind or left.kind not in takes or (operator == "MOD" and left.kind != "DINT"):
            raise self.fault(f"{left.kind} {operator} {right.kind}")
        if logical or compares:
            return Term(f"({left.code} {PYTHON.get(operator, operator)} {right.code})", "BOOL")
        if operator in ("/", "MOD"):
            if left.kind == "DINT":
                raise self.fault("a DINT is divided, which rounds")
            return Term(f"_divided({left.code}, {right.code})", left.kind)
        code = f"({left.code} {operator} {right.code})"
        return Term(f"_dint({code})" if left.kind == "DINT" else code, left.kind)

    def unary(self) -> Term:
        if self.next.text not in ("NOT", "-"):
            return self.primary()
        operator, of = self.take().text, self.unary()
        if (of.kind == "BOOL") != (operator == "NOT"):
            raise self.fault(f"{operator} {of.kind}")
        return Term(f"(not {of.code})" if operator == "NOT" else f"(-{of.code})", of.kind)

    def primary(self) -> Term:
        token = self.next
        if token.text == "(":
            self.take()
            inner = self.expression()
            self.take(")")
            return inner
        if token.text in ("TRUE", "FALSE") or token.kind in ("real", "integer"):
            kind = {"real": "LREAL", "integer": "DINT"}.get(token.kind, "BOOL")
            return Term(repr(self.literal(kind)), kind)
        if token.kind == "name" and token.text in FUNCTIONS:
            return self.function()
        return self.reference()

    def function(self) -> Term:
        name = self.take().text
        code, takes, count, result = FUNCTIONS[name]
        self.take("(")
        given = [self.expression()]
        while self.next.text == ",":
            self.take()
            given.append(self.expression())
        self.take(")")
        kinds = {term.kind for term in given}
        if len(given) != count or len(kinds) != 1 or not kinds <= set(takes):
            raise self.fault(f"{name} of {', '.join(term.kind for term in given)}")
        return Term(f"{code}({', '.join(term.code for term in given)})", result or given[0].kind)

    def reference(self) -> Term:
        """A variable, or an element of an array."""
        name = self.take_kind("name").text
        if name not in self.variables:
            raise self.fault(f"{name} is not declared")
        of = self.variables[name]
        if of.low is None:
            return Term(f"v_{name}", of.kind)
        self.take("[")
        index = self.expression()
        self.take("]")
        if index.kind != "DINT":
            raise self.fault(f"{name} is indexed by {index.kind}")
        return Term(f"v_{name}[_place({index.code}, {of.low}, {of.high})]", of.kind)


class FunctionBlock:
    """The function block of a text, with its variables; one instance keeps its state from call to call.

    Raises
    ------
    GrammarError, DeclarationError
        The text is no function block of the language, or its types do not agree.
    """

    def __init__(self, text: str) -> None:
        parser = Parser(tokens(text))
        parser.block()
        self.name, self.variables = parser.name, parser.variables
        self._code = compile("\n".join(parser.lines), self.name, "exec")
        self._values: dict[str, Any] = dict(RUN)
        for name, of in self.variables.items():
            self._values[f"v_{name}"] = list(of.value) if of.low is not None else of.value

    def __getitem__(self, name: str) -> Any:
        return self._values[f"v_{name.upper()}"]

    def names(self, section: str) -> list[str]:
        """Names of the variables of VAR_INPUT, VAR_OUTPUT, VAR or CONSTANT."""
        return [name for name, of in self.variables.items() if of.section == section]

    def call(self, **inputs: float | bool) -> None:
        """One call with these inputs; an input that is not given keeps its value.

        Raises
        ------
        UndefinedError
            An operation whose result the standard leaves to the implementation.
        """
        for name, value in inputs.items():
            of = self.variables[name.upper()]
            if of.section != "VAR_INPUT" or isinstance(value, bool) != (of.kind == "BOOL"):
                raise DeclarationError(f"{name} := {value!r}")
            self._values[f"v_{name.upper()}"] = value if of.kind == "BOOL" else float(value)
        exec(self._code, self._values)  # noqa: S102  translated from our own export
