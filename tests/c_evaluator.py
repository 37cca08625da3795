"""An evaluator in Python of the C that the exports of the controller use, for a machine without a compiler.

It translates a text into Python functions: structures are objects, pointers to them the objects themselves, `long`,
`int` and enumerations Python integers, real numbers floats. Whatever it does not know is a SyntaxError. A consumer
test shows that it equals the compiled C.
"""

import keyword
import re

TOKEN = re.compile(
    r"""\s+|/\*.*?\*/|//[^\n]*|(?P<string>"(?:[^"\\]|\\.)*")|(?P<number>0x[0-9a-fA-F]+|(?:\d+\.\d*|\.\d+|\d+)(?:[eE][-+]?\d+)?)L?"""
    r"""|(?P<name>[A-Za-z_]\w*)|(?P<op>->|\+\+|--|&&|\|\||[-+*/%<>=!]=|[-+*/%<>=!?:;,.(){}\[\]&])""",
    re.DOTALL | re.VERBOSE,
)  # fmt: skip
BINARY = [("||",), ("&&",), ("==", "!="), ("<", ">", "<=", ">="), ("+", "-"), ("*", "/", "%")]
KEPT = {"if", "else", "for", "return"}
WORDS = {"const", "static", "extern", "struct", "long", "int", "double", "void", "char"}


def preprocessed(text, defined=()):
    """Text without directives: conditions taken with no macro defined but these, and its own defines replaced."""
    macros, lines, taken = dict.fromkeys(defined, ""), [], [True]
    for line in re.sub(r"/\*.*?\*/|//[^\n]*", " ", text, flags=re.DOTALL).splitlines():
        word, _, rest = line.strip().partition(" ")
        if word in ("#ifdef", "#ifndef"):
            taken.append(taken[-1] and (rest.strip() in macros) == (word == "#ifdef"))
        elif word == "#endif":
            taken.pop()
        elif taken[-1] and word == "#define":
            name, _, value = rest.strip().partition(" ")
            macros[name] = value.strip()
        elif taken[-1] and word == "#error":
            raise SyntaxError(rest)
        elif taken[-1] and not word.startswith("#"):
            lines.append(line)
    out = "\n".join(lines)
    for _ in range(3):
        out = re.sub(r"[A-Za-z_]\w*", lambda m: macros.get(m[0], m[0]), out)
    return out


def tokens_of(text):
    """Kind and text of each token."""
    found, place = [], 0
    while place < len(text):
        match = TOKEN.match(text, place)
        if match is None:
            raise SyntaxError(f"not C of the exports: {text[place : place + 40]!r}")
        if match.lastgroup:
            text_ = match[match.lastgroup]  # `in` is a word of Python, but not of C
            found.append((match.lastgroup, f"{text_}_" if keyword.iskeyword(text_) and text_ not in KEPT else text_))
        place = match.end()
    return [*found, ("end", "")]


class Structure:
    """An object with the members of a C structure, all zero."""

    def __init__(self, members):
        self.clear(members)

    def clear(self, members=None):
        """Set every member to zero, as memset does."""
        self.__dict__["_members"] = members = members or self._members
        for name, length in members:
            setattr(self, name, [0] * length if length else 0)


def divided(a, b):
    """C's quotient: truncated for integers; a real quotient by zero is infinite or not a number."""
    if isinstance(a, int) and isinstance(b, int):
        return int(a / b)
    try:
        return a / b
    except ZeroDivisionError:
        return float("nan") if a != a or a == 0 else float("inf") * (1 if a > 0 else -1)


class Translator:
    """The C tokens of a file, translated into Python source by recursive descent."""

    def __init__(self, text):
        self.tokens, self.at = tokens_of(text), 0
        self.types, self.enums, self.lines = {}, {}, []

    def see(self, *texts):
        return self.tokens[self.at][1] in texts and self.tokens[self.at][0] != "string"

    def take(self, text=None):
        kind, found = self.tokens[self.at]
        if text is not None and found != text:
            raise SyntaxError(
                f"{found!r} instead of {text!r}, after {' '.join(t for _, t in self.tokens[self.at - 8 : self.at])}"
            )
        self.at += 1
        return found if kind != "end" else ""

    def accept(self, text):
        if self.see(text):
            self.at += 1
            return True
        return False

    def is_type(self):
        return self.see(*WORDS, *self.types)

    def type_name(self):
        """The name of a type, without qualifiers and stars."""
        name = ""
        while self.is_type() or self.see("*"):
            word = self.take()
            name = self.take() if word == "struct" else word if word not in ("const", "static", "extern", "*") else name
        return name

    def file(self):
        while self.tokens[self.at][0] != "end":
            if self.accept("typedef"):
                self.typedef()
            else:
                self.declared_or_defined()
        return "\n".join(self.lines)

    def typedef(self):
        if self.accept("enum"):
            self.take("{")
            names = []
            while not self.accept("}"):
                names.append(self.take())
                self.accept(",")
            self.enums.update({name: number for number, name in enumerate(names)})
            self.types[self.take()] = None
        elif self.accept("struct"):
            self.take("{")
            members = []
            while not self.accept("}"):
                self.type_name()
                members += self.members()
            self.types[self.take()] = members
        else:
            self.type_name()
            self.types[self.take()] = None
        self.take(";")

    def members(self):
        found = []
        while True:
            name, length = self.take(), 0
            if self.accept("["):
                length = eval(self.expression(), {}, {})  # noqa: S307  a number of this repository's own text
                self.take("]")
            found.append((name, length))
            if self.accept(";"):
                return found
            self.take(",")

    def declared_or_defined(self):
        kind = self.type_name()
        name = self.take()
        if self.accept("("):
            arguments = []
            while not self.accept(")"):
                self.type_name()
                if not self.see(")", ","):
                    arguments.append(self.take())
                self.accept(",")
            if self.accept(";"):
                return
            self.lines.append(f"def {name}({', '.join(arguments)}):")
            self.block(1)
        elif self.accept("="):
            self.take("{")
            values = []
            while not self.accept("}"):
                values.append(self.ternary())
                self.accept(",")
            self.take(";")
            members = [member for member, _ in self.types[kind]]
            if len(members) != len(values):
                raise SyntaxError(f"{len(values)} values for {len(members)} members of {kind}")
            self.lines.append(f"{name} = new({kind!r})")
            self.lines += [f"{name}.{m} = {v}" for m, v in zip(members, values, strict=True)]
        else:
            self.take(";")
            self.lines.append(f"{name} = new({kind!r})")

    def block(self, depth):
        self.take("{")
        self.lines.append("    " * depth + "pass")
        while not self.accept("}"):
            self.statement(depth)

    def body(self, depth):
        if self.see("{"):
            self.block(depth)
        else:
            self.statement(depth)

    def statement(self, depth):
        line = lambda text: self.lines.append("    " * depth + text)  # noqa: E731
        if self.accept("if"):
            self.take("(")
            line(f"if {self.expression()}:")
            self.take(")")
            self.body(depth + 1)
            if self.accept("else"):
                line("else:")
                self.body(depth + 1)
        elif self.accept("for"):
            self.loop(depth)
        elif self.accept("return"):
            line("return" if self.see(";") else f"return {self.expression()}")
            self.take(";")
        elif self.is_type():
            kind = self.type_name()
            while True:
                name = self.take()
                first = self.ternary() if self.accept("=") else f"new({kind!r})" if self.types.get(kind) else "None"
                line(f"{name} = {first}")
                if self.accept(";"):
                    break
                self.take(",")
        else:
            for text in self.effects(";"):
                line(text)

    def loop(self, depth):
        line = lambda text, more=0: self.lines.append("    " * (depth + more) + text)  # noqa: E731
        self.take("(")
        for text in self.effects(";"):
            line(text)
        line(f"while {'True' if self.see(';') else self.expression()}:")
        self.take(";")
        steps = self.effects(")")
        self.body(depth + 1)
        for text in steps:
            line(text, 1)

    def effects(self, end):
        """Assignments, steps and calls up to a token, between commas."""
        found = []
        while not self.accept(end):
            found.append(self.effect())
            self.accept(",")
        return found

    def effect(self):
        for sign in ("++", "--"):
            if self.accept(sign):
                return f"{self.unary()} {sign[0]}= 1"
        target = self.ternary()
        for operator in ("+=", "-=", "*="):
            if self.accept(operator):
                return f"{target} {operator} {self.ternary()}"
        if self.accept("/="):
            return f"{target} = divided({target}, {self.ternary()})"
        if self.accept("="):
            return f"{target} = {self.effect()}"
        return target

    def expression(self):
        return self.ternary()

    def ternary(self):
        test = self.binary(0)
        if not self.accept("?"):
            return test
        yes = self.ternary()
        self.take(":")
        return f"({yes} if {test} else {self.ternary()})"

    def binary(self, level):
        if level == len(BINARY):
            return self.unary()
        left = self.binary(level + 1)
        while self.see(*BINARY[level]):
            operator = self.take()
            right = self.binary(level + 1)
            if operator in ("&&", "||"):
                left = f"int(bool({left} {'and' if operator == '&&' else 'or'} {right}))"
            elif operator == "/":
                left = f"divided({left}, {right})"
            elif operator in ("+", "-", "*", "%"):
                left = f"({left} {operator} {right})"
            else:
                left = f"int({left} {operator} {right})"
        return left

    def unary(self):
        if self.accept("sizeof"):
            return f"None if {self.unary()} else None"
        if self.accept("!"):
            return f"int(not {self.unary()})"
        if self.accept("-"):
            return f"(-{self.unary()})"
        if self.accept("*") or self.accept("&"):
            return self.unary()
        if self.see("(") and self.tokens[self.at + 1][1] in WORDS | set(self.types):
            self.take("(")
            kind = self.type_name()
            self.take(")")
            cast = {"void": "", "long": "int", "int": "int"}.get(kind, "float")
            return f"{cast}({self.unary()})"
        return self.postfix()

    def postfix(self):
        kind, text = self.tokens[self.at]
        self.at += 1
        if text == "(":
            out = f"({self.ternary()})"
            self.take(")")
        elif kind in ("number", "name", "string"):
            out = text
        else:
            raise SyntaxError(f"{text!r} begins no expression")
        while True:
            if self.accept("->") or self.accept("."):
                out += f".{self.take()}"
            elif self.accept("["):
                out += f"[{self.ternary()}]"
                self.take("]")
            elif self.accept("("):
                arguments = []
                while not self.accept(")"):
                    arguments.append(self.ternary())
                    self.accept(",")
                out += f"({', '.join(arguments)})"
            else:
                return out


def evaluated(text, **names):
    """Functions and objects of a C text by name, with ``new(type)`` for an object of a type."""
    translator = Translator(preprocessed(text))
    source = translator.file()
    space = {
        **translator.enums,
        "new": lambda kind: Structure(translator.types[kind]),
        "memset": lambda where, zero, size: where.clear(),
        "divided": divided,
        **names,
    }
    exec(compile(source, "C", "exec"), space)  # noqa: S102  a translation of this repository's own text
    return space
