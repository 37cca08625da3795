"""Messages of the commands in the words of the page: forms and fields, with links, in place of commands and options."""

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

from markupsafe import Markup, escape

from .command_forms import ENGAGEMENT, Action
from .options import pairs

FIELDS: Final = {  # of the option of a file: label of its field, and its id on the page
    "--edge": ("Column of the cutting edges", "set-edge"),
    "--tool": ("Tool", "set-tool"),
    "--work": ("Work material", "set-work"),
    "--criterion": ("Wear at the end of tool life", "set-criterion"),
    "--gauge-sd": ("Standard deviation of the wear gauge", "set-gauge-sd"),
    "--by": ("Category whose levels shift the laws", "set-by"),
    "--value": ("Constant", "set-value"),
    "--range": ("Values of coded levels", "set-range"),
    "--decimal": ("Decimal mark", "set-decimal"),
    "--delimiter": ("Delimiter of cells", "set-delimiter"),
    "--process": ("Process", "set-process"),
    "--sheet": ("Sheet", "set-sheet"),
    "--hidden": ("Hidden rows and columns", "set-hidden"),
    "--correct": ("Correct", "set-correct"),
    "--leave-out": ("Leave out", "leave-out"),
    "--law": ("Law", "set-law"),
    "--form": ("Form of the law", "set-form"),
    "--error": ("Error", "set-error"),
    "--input": ("Command", "set-input"),
    "--output": ("Measured", "set-output"),
    "--reference": ("Set point", "set-reference"),
    "--rate": ("Samples per second", "set-rate"),
    "--time": ("Time", "set-time"),
    "--sample-time": ("Seconds between samples", "set-sample-time"),
    "--resample": ("Resample to, Hz", "set-resample"),
    "--full": ("card", "card"),
    "--force": ("button below", "laws-answer"),
}
NO_VALUES: Final = {  # words of a sentence that follow an option
    "and", "or", "if", "is", "are", "it", "reads", "gives", "takes", "where", "to", "for", "in", "on", "of",
    "with", "keeps", "names", "sets", "changes", "adds", "both", "exports",
}  # fmt: skip
OPTION: Final = re.compile(
    r"--([a-z]+(?:-[a-z]+)*)(?:([ =\n]\s*)(\w+='[^'\n]*'|\w+=\"[^\"\n]*\"|'[^'\n]*'|\"[^\"\n]*\"|[^\s'\"`]+))?"
)
COMMAND: Final = re.compile(r"([`']?)fitmodels\s(?=\w)")
TOKEN: Final = re.compile(r"\s+(?:\\\s+)?('[^'\n]*'|\"[^\"\n]*\"|\S+)")
PREFIX: Final = re.compile(r"(?m)^fitmodels(?: [a-z-]+)?: ")
HELP: Final = re.compile(r"(?:[;,]|(?<![\s;,]))\s+see\s+'fitmodels\s+[A-Za-z-]+\s+-h'")
COLUMNS: Final = re.compile(r"[^ ] {2,}[^ ]+(?: [^ ]+)* {2,}[^ ]")  # three columns of a table
NEXT: Final = re.compile(r"(?m)^Next\n(?:[ \t].*+\n?+)*+")
PLAIN: Final = (
    (re.compile(r"(?<!with)(?<!by)(?<!\s)\s+--force\b"), ""),  # forms replace what they wrote before
    (re.compile(r"by\s+the\s+option\s+of\s+its\s+name"), "by its field under More fields"),
    (re.compile(r"(?<!\s)\s+\(did you mean --[a-z-]+\?\)"), ""),  # nobody types options here
    (re.compile(r"\b(?:add|give)\s+(?=--(?:unit [^=\s]+(?:\s|\.)|scaling))"), "set "),
    (re.compile(r"(--scaling \S+) (?=--unit)"), r"\1 and "),
    (re.compile(r" \(card\.html; tables: --full\)"), ""),
    (re.compile(r"(?<=[\d.] )um\b"), "µm"),
)
NAMES: Final = {
    **{
        name.replace("-", "_"): label.split(" (")[0].partition(",")[0].replace("{load}", "")
        for name, label, _ in ENGAGEMENT
    },
    "on_fault": "on a lost or wrong load",
    "feed_low": "lower feed limit",
    "feed_high": "upper feed limit",
}  # of the constant load in files: labels of their fields
NAME: Final = re.compile(  # a name that is a word, too, at the beginning of an item of a list
    rf"\b(?:{'|'.join(name for name in NAMES if '_' in name)})\b"
    rf"|(?<=[:;]\s)(?:{'|'.join(name for name in NAMES if '_' not in name)})\b"
)


@dataclass(frozen=True, slots=True)
class Places:
    """Places of the page to which a message of a command can lead.

    Attributes
    ----------
    forms : mapping of str to Action
        Forms by the name of their command.
    columns : mapping of str to int
        Number of the column of each role.
    own : str
        The command that the message is of, whose fields come first.
    """

    forms: Mapping[str, Action]
    columns: Mapping[str, int]
    own: str = ""

    def field(self, option: str, command: str) -> tuple[str, str] | None:
        """Label and id of the field of an option of a command, without which it is one of the file."""
        for name in dict.fromkeys((command, *(() if option in (*FIELDS, "--unit", "--map") else self.forms))):
            for one in self.forms[name].inputs if name in self.forms else ():
                if one.words.split(" ")[0] == option:
                    return f"{self.forms[name].title}, {_short(one.label)}", f"{name}-{one.name}"
        return FIELDS.get(option)


def _short(label: str) -> str:
    """The name of a field without its unit and explanation.

    >>> _short("highest command: upper bound of the feed, in the unit below")
    'highest command'
    """
    return re.split(r"[,:;]| \(", label)[0]


def on_page(text: str, to: Places) -> Markup:
    """A message with links to forms and fields in place of commands and options.

    >>> on_page("work: not named; name it with --work. See --seed", Places({}, {}))
    Markup('work: not named; name it with <a href="#set-work" data-open="set-work">Work material</a>. See --seed')
    >>> on_page("the wear is 0.3 mm: --unit VB=um or --edge none", Places({}, {"VB": 4}))  # doctest: +ELLIPSIS
    Markup('the wear is 0.3 mm: <a href="#unit-4" ...>unit of VB</a>: <code>um</code> or <a ...
    """
    text = HELP.sub("", PREFIX.sub("", text))
    for old, new in PLAIN:
        text = old.sub(new, text)
    if to.own == "settings":
        text = NAME.sub(lambda name: NAMES[name[0]], text)
    found, end = Markup(), 0
    for start in COMMAND.finditer(text):
        if start.start() < end:
            continue
        shown, after = _command(text, start, to)
        found += _options(text[end : start.start()], to, to.own) + shown
        end = after
    return found + _options(text[end:], to, to.own)


def screen(text: str, to: Places) -> Markup:
    r"""A result in the words of the page; rows of its tables are not wrapped.

    >>> screen("Gains: Kp 1.\nrise time  1.9 s  <= 2 s", Places({}, {}))
    Markup('Gains: Kp 1.\n<span class="row">rise time  1.9 s  &lt;= 2 s</span>')
    """
    lines = on_page(text, to).split("\n")
    rows = (Markup('<span class="row">{}</span>').format(line) if COLUMNS.search(line) else line for line in lines)
    return Markup("\n").join(rows)


def plain(text: str, to: Places) -> str:
    """A message in the words of the page, without links.

    >>> plain("--correct 31: write TARGET:SYMBOL*NUMBER.", Places({}, {}))
    'Correct: 31: write TARGET:SYMBOL*NUMBER.'
    """
    return on_page(text, to).striptags()


def in_parts(text: str, to: Places) -> tuple[Markup, Markup]:
    """A message in the words of the page, and its details, which the page shows on request."""
    shown, _, after = screen(text, to).partition("\n  Details\n")
    details, _, rest = after.partition("\n\n")
    return Markup("{}\n\n{}").format(shown, rest) if rest else shown, details


def of_laws(text: str, to: Places) -> Markup:
    """The first screen of the laws, without the commands of its end, which the page has as forms."""
    return screen(NEXT.sub("", text), to)


def described(options: str, to: Places) -> Markup:
    """Options as typed, in the words of the page and without links.

    >>> described("--unit VB=um --correct 'lines 24:VB/10'", Places({}, {}))
    Markup('unit of VB: <code>um</code>, Correct: <code>lines 24:VB/10</code>')
    """
    return Markup(", ").join(_worded(name, value, to, "")[0] for name, value in pairs(shlex.split(options)))


def _command(text: str, start: re.Match[str], to: Places) -> tuple[Markup, int]:
    """A command in the words of the page, and where it ends in the text."""
    quote = start[1]
    if quote and (end := text.find(quote, start.end())) >= 0:
        tokens, after = text[start.end() : end].replace("\\\n", " ").split(), end + 1
    else:
        tokens, after = _tokens(text, start.end() - 1)
    name, rest = (tokens[0], tokens[1:]) if tokens else ("", [])
    if name in to.forms and "--as" not in rest:
        form = to.forms[name]
        given = _given(rest)
        options = [
            _linked(*_worded(option, value, to, name))
            for option, value in _pairs_of(rest)
            if option in ("--" + one.words[2:].split(" ")[0] for one in form.inputs)
        ]
        shown = Markup(", ").join(options) if options else _linked(escape(form.title), f"action-{name}", given)
        return shown + (Markup(": <code>{}</code>").format(given) if given else ""), after
    if name == "ident" and "--as" not in rest:
        return _linked(Markup("columns of a record"), "set-input"), after
    if name == "look":
        return _linked(Markup("How the file was read"), "h-reading"), after
    if "." in name:
        worded = [_linked(*_worded(option, value, to, "")) for option, value in _pairs_of(rest)]
        return Markup(", ").join(worded) or _linked(Markup("the fit"), "h-laws"), after
    return Markup("<code>{}</code> (in a terminal)").format(" ".join(["fitmodels", *tokens])), after


def _given(words: Sequence[str]) -> str:
    """Values by name among the words of a command that are none of an option.

    >>> _given(["a.csv", "P=7kW", "--map", "f=col3", "f=0.1:0.4"])
    'P=7kW f=0.1:0.4'
    """
    values = (word for before, word in pairwise(["", *words]) if not before.startswith("--"))
    return " ".join(word for word in values if "=" in word and not word.startswith("-"))


def _tokens(text: str, at: int) -> tuple[list[str], int]:
    """Words of a command that stands in a sentence, and where they end."""
    found: list[str] = []
    while (token := TOKEN.match(text, at)) is not None:
        word = token[1]
        bare = word.rstrip(".,;:)")
        is_value = bool(found) and found[-1].startswith("--") and "=" not in found[-1] and bare not in NO_VALUES
        if found and not (is_value or _is_argument(bare)):
            break
        found.append(bare)
        at = token.end() - (len(word) - len(bare))
        if word != bare:
            break
    return found, at


def _is_argument(word: str) -> bool:
    """Whether a word is one of a command rather than of the sentence around it.

    >>> [_is_argument(word) for word in ("P=7kW", "PARAMS", "run.csv", "a/params.json", "by", "adds")]
    [True, True, True, True, False, False]
    """
    known = word.startswith(("-", "'", '"')) or "=" in word or "/" in word
    return known or bool(re.fullmatch(r"[A-Z]\w{0,3}|[A-Z]{2,}|[\w-]+\.(?:json|csv|txt|xlsx?)", word))


def _pairs_of(words: Sequence[str]) -> list[tuple[str, str]]:
    """Options among the words of a command, with their values."""
    try:
        split = shlex.split(" ".join(words))
    except ValueError:
        return []
    first = next((k for k, word in enumerate(split) if word.startswith("--")), len(split))
    return [pair for pair in pairs(split[first:]) if pair[0]]


def _options(text: str, to: Places, command: str) -> Markup:
    """A text without commands, its options in the words of the page."""
    found, end = Markup(), 0
    for one in OPTION.finditer(text):
        option, value = f"--{one[1]}", one[3] or ""
        if to.field(option, command) is None and option not in ("--unit", "--map"):
            continue
        written = value if value.endswith(("'", '"', "=...")) else value.rstrip(".,;:)")
        if "=..." in value:
            written = value[: value.index("=...") + 4]
        if value in NO_VALUES or value.startswith("("):
            written, stop = "", one.start() + len(option)
        else:
            stop = one.end() - len(value) + len(written)
        bare = re.sub("['\"]", "", written)
        found += escape(text[end : one.start()]) + _linked(*_worded(option, bare, to, command), bare)
        end = stop
    return found + escape(text[end:])


def _worded(option: str, value: str, to: Places, command: str) -> tuple[Markup, str]:
    """An option in the words of the page, and the id of its field."""
    role, equals, rest = value.partition("=")
    known = to.field(option, command)
    if known is not None:
        label, place, shown = *known, value
    elif option == "--unit":
        number = to.columns.get(role)
        label, place, shown = f"unit of {role}" if role else "unit", f"unit-{number}" if number else "columns", rest
    elif option == "--map":
        label, place, shown = _role_words(role, rest, to) if equals else ("role of the column", "columns", "")
    else:
        label, place, shown = option, "", value
    words = escape(label)
    return (words + Markup(": <code>{}</code>").format(shown) if shown else words), place


def _role_words(role: str, column: str, to: Places) -> tuple[str, str, str]:
    """Label, id and value of the menu that gives a column its role."""
    number = to.columns.get(role)
    own = re.fullmatch(r"col(\d+)", column)
    if column == "...":
        return "role of its column", "columns", role
    if column == "none":
        return f"role of the column of {role}", f"role-{number}" if number else "columns", "not used"
    return f"role of column {own[1] if own else column}", f"role-{own[1]}" if own else "columns", role


def _linked(words: Markup, place: str, given: str = "") -> Markup:
    """Words with a link to a place of the page; ``given`` fills in its form."""
    if not place:
        return words
    label, code, value = words.partition(": <code>")
    fill = Markup(' data-fill="{}"').format(given) if given else Markup()
    link = Markup('<a href="#{0}" data-open="{0}"{1}>{2}</a>').format(place, fill, Markup(label))  # noqa: S704
    return link + Markup(code + value)  # noqa: S704  parts of what was escaped


def places(forms: Sequence[Action], found: Mapping[str, Any], own: str = "") -> Places:
    """Places of a page with these forms and the JSON of its reading."""
    columns = {one["role"]: one["number"] for one in found.get("columns", ()) if one.get("role")}
    return Places({one.name: one for one in forms}, columns, own)


def colour(level: str) -> str:
    """Class of the style sheet in which a level of a verdict is shown, beside its words.

    >>> colour("usable with reservations"), colour("do not use")
    ('doubt', 'bad')
    """
    if "reservations" in level or level.startswith("outdated"):
        return "doubt"
    return "bad" if level.startswith("do not") else "good" if level.startswith("usable") else ""
