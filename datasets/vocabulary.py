"""Roles of the columns of laboratory files, and the names by which they are recognised.

Symbols follow ISO 3002 (cutting conditions, forces) and ISO 3685 (wear, tool life); names are English,
German, French and Spanish. Words match whatever their case, accents and separators (``Cutting_Speed``,
``cutting-speed``), symbols of two letters and more in any case (``VC``, ``a_p``). Case decides between
one-letter symbols, and between fz and Fz: f feed and F force, d depth and D diameter, t time and T life.
"""

import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from ..core.suggestions import closest
from .units import canonical, is_unit, same_dimension

__all__ = [
    "FLANK_WEAR",
    "MEASURED",
    "ROLES",
    "UNNAMED",
    "USUAL_CRITERION",
    "WEAR",
    "Role",
    "fits",
    "role_of",
    "role_of_mean",
    "role_of_unit",
    "role_within",
    "roles_named",
    "suggest_role",
    "understood_unit",
]

Kind = Literal["condition", "time", "wear", "load", "surface", "other", "label"]
FLANK_WEAR = ("AW", "VB")  # average and width of the flank, the wear of laws of wear and of tool life
WEAR = (*FLANK_WEAR, "VBC", "VBN")  # and of nose and notch
MEASURED: tuple[Kind, ...] = ("wear", "load", "surface")  # kinds of the responses of a test
USUAL_CRITERION = 0.3  # mm, average flank wear at the end of tool life (ISO 3685)
MARK = " mark"  # "VB mark" is the column of the marked values of VB (<0.05, 0.24*)
UNNAMED = {"tool": "unnamed-tool", "work": "unnamed-work"}  # names where the file gives none


@dataclass(frozen=True, slots=True)
class Role:
    """Role of a column: symbol, quantity, canonical unit ("" for a label), kind, all names, and local quantities.

    ``local`` holds the quantity in German, French and Spanish, as far as it is known.

    >>> ROLES["V"].quantity, ROLES["V"].unit
    ('cutting speed', 'm/min')
    """

    symbol: str
    quantity: str
    unit: str
    kind: Kind
    names: tuple[str, ...]
    local: tuple[str, ...] = ()


def _role(symbol: str, quantity: str, unit: str, kind: Kind, *names: str) -> Role:
    """Build a role whose further names come as lists, a string for each language."""
    local = tuple(listed.split(", ")[0] for listed in names[1:4])
    return Role(symbol, quantity, unit, kind, (symbol, quantity, *", ".join(names).split(", ")), local)


# fmt: off
_TABLE = (
    _role("V", "cutting speed", "m/min", "condition", "v, vc, speed, surface speed",
          "Schnittgeschwindigkeit, Schnittgeschw, Geschwindigkeit", "vitesse de coupe, vitesse",
          "velocidad de corte, velocidad"),
    _role("f", "feed", "mm/rev", "condition", "fn, feed per revolution, feed per rev",
          "Vorschub, Vorschub pro Umdrehung", "avance, avance par tour",
          "avance por vuelta, avance por revolución"),
    _role("fz", "feed per tooth", "mm/tooth", "condition", "chip load", "Vorschub pro Zahn, Zahnvorschub",
          "avance par dent", "avance por diente"),
    _role("fm", "feed rate", "mm/min", "condition", "vf, feed speed, table feed", "Vorschubgeschwindigkeit",
          "vitesse d'avance", "velocidad de avance"),
    _role("d", "depth of cut", "mm", "condition",
          "ap, DOC, depth, cutting depth, axial depth of cut, axial depth",
          "Schnitttiefe, Schnittiefe, Spantiefe, Spanungstiefe, Zustellung",
          "profondeur de passe, profondeur de coupe, profondeur",
          "profundidad de corte, profundidad de pasada, profundidad"),
    _role("ae", "width of cut", "mm", "condition",
          "WOC, radial depth of cut, radial depth, radial engagement",
          "Eingriffsbreite, Schnittbreite", "largeur de coupe, engagement radial",
          "ancho de corte, profundidad radial"),
    _role("n", "spindle speed", "1/min", "condition", "rpm, rotational speed", "Drehzahl, Spindeldrehzahl",
          "vitesse de rotation, vitesse de broche, fréquence de rotation",
          "velocidad de giro, velocidad del husillo"),
    _role("t", "cutting time", "min", "time", "tc, time, machining time, time in cut",
          "Zeit, Schnittzeit, Eingriffszeit", "temps, temps de coupe, temps d'usinage",
          "tiempo, tiempo de corte, tiempo de mecanizado"),
    _role("T", "tool life", "min", "time", "life", "Standzeit", "durée de vie, tenue d'outil",
          "vida útil, vida de la herramienta, vida de herramienta"),
    _role("D", "diameter", "mm", "other", "Ø, ø, workpiece diameter, work diameter",
          "Durchmesser, Werkstückdurchmesser", "diamètre, diamètre de la pièce",
          "diámetro, diámetro de la pieza"),
    _role("Dc", "tool diameter", "mm", "other",
          "cutter diameter, mill diameter, end mill diameter, milling cutter diameter, drill diameter, drill dia",
          "Werkzeugdurchmesser, Fräserdurchmesser, Bohrerdurchmesser",
          "diamètre de l'outil, diamètre de la fraise, diamètre de fraise, diamètre du foret",
          "diámetro de la herramienta, diámetro de la fresa, diámetro de fresa, diámetro de la broca"),
    _role("re", "nose radius", "mm", "other",
          "r_e, rε, r_eps, r_epsilon, r_n, tool nose radius, insert nose radius, corner radius, insert radius",
          "Eckenradius, Spitzenradius", "rayon de bec, rayon de pointe", "radio de punta, radio de nariz"),
    _role("kappa", "entering angle", "deg", "other",
          "κ, κr, kr, kappa r, kapr, tool cutting edge angle, major cutting edge angle",
          "Einstellwinkel, Hauptschneidenwinkel", "angle de direction d'arête", "ángulo de posición"),
    _role("lead", "lead angle", "deg", "other", "psir, side cutting edge angle"),
    _role("sigma", "point angle", "deg", "other", "σ, drill point angle, tip angle", "Spitzenwinkel",
          "angle de pointe", "ángulo de punta"),
    _role("z", "number of teeth", "1", "other",
          "Z, zn, zc, teeth, flutes, no of teeth, number of flutes, no of flutes",
          "Zähnezahl, Schneidenzahl, Zähne, Anzahl Zähne, Anzahl der Zähne",
          "nombre de dents, dents", "número de dientes, dientes"),
    _role("lf", "cut length", "mm", "other",
          "L, length of cut, cutting length, length cut, feed travel, feed path",
          "Schnittlänge, Vorschubweg, Fräsweg, Bohrweg", "longueur de coupe, longueur usinée",
          "longitud de corte, longitud mecanizada"),
    _role("lc", "cutting path", "m", "other",
          "spiral length, spiral cutting length, cutting distance, sliding distance", "Schnittweg",
          "chemin de coupe", "recorrido de corte"),
    _role("AW", "average wear", "mm", "wear", "wear, mean wear, tool wear, average tool wear",
          "Verschleiß, mittlerer Verschleiß, Werkzeugverschleiß", "usure, usure moyenne, usure de l'outil",
          "desgaste, desgaste medio, desgaste de la herramienta"),
    _role("VB", "flank wear", "mm", "wear",
          "flank, VBB, VBmax, VBBmax, maximum flank wear, flank wear land, flank wear width",
          "Freiflächenverschleiß, Verschleißmarkenbreite", "usure en dépouille, usure frontale",
          "desgaste de flanco, desgaste del flanco"),
    _role("VBC", "nose wear", "mm", "wear", "nose, nose flank wear, corner wear, nose wear land",
          "Eckenverschleiß, Spitzenverschleiß", "usure du bec, usure de bec, usure de pointe",
          "desgaste de punta, desgaste de la punta"),
    _role("VBN", "notch wear", "mm", "wear", "VN, notch, groove wear, notch wear land",
          "Kerbverschleiß", "usure en entaille", "desgaste de entalla, desgaste en entalla"),
    _role("Fx", "force along x", "N", "load", "force x, x force", "Kraft x", "effort x", "fuerza x"),
    _role("Fy", "force along y", "N", "load", "force y, y force", "Kraft y", "effort y", "fuerza y"),
    _role("Fz", "force along z", "N", "load", "force z, z force", "Kraft z", "effort z", "fuerza z"),
    _role("Fxz", "thrust force", "N", "load", "thrust"),
    _role("Fc", "cutting force", "N", "load", "main cutting force, tangential force",
          "Schnittkraft, Hauptschnittkraft",
          "effort de coupe, force de coupe, effort tangentiel", "fuerza de corte"),
    _role("Ff", "feed force", "N", "load", "feed force", "Vorschubkraft", "effort d'avance, force d'avance",
          "fuerza de avance"),
    _role("Fp", "passive force", "N", "load", "back force", "Passivkraft",
          "effort passif, effort de refoulement",
          "fuerza pasiva"),
    _role("F", "resultant force", "N", "load", "force, total force, Fres",
          "Kraft, Zerspankraft, resultierende Kraft",
          "effort, force résultante", "fuerza, fuerza resultante"),
    _role("P", "power", "kW", "load", "Pc, cutting power, spindle power",
          "Leistung, Schnittleistung, Spindelleistung",
          "puissance, puissance de coupe", "potencia, potencia de corte"),
    _role("M", "torque", "Nm", "load", "Mc, Mz, cutting torque, spindle torque, drilling torque, moment",
          "Drehmoment, Schnittmoment, Bohrmoment",
          "couple, couple de coupe", "par de torsión, par de corte"),
    _role("I", "spindle current", "A", "load", "current, motor current", "Strom, Spindelstrom, Motorstrom",
          "courant, courant de broche, intensité", "corriente, corriente del husillo"),
    _role("theta", "temperature", "degC", "load",
          "θ, temp, cutting temperature, tool temperature, interface temperature, tool chip interface temperature",
          "Temperatur, Schnitttemperatur, Zerspantemperatur", "température, température de coupe",
          "temperatura, temperatura de corte"),
    _role("MRR", "material removal rate", "mm3/min", "other", "Q, Qw, removal rate, metal removal rate",
          "Zeitspanvolumen, Zeitspanungsvolumen", "débit de copeaux",
          "caudal de viruta, tasa de remoción de material"),
    _role("Ra", "arithmetic mean roughness", "um", "surface",
          "roughness, surface roughness, average roughness, surface finish, roughness average",
          "Rauheit, Rauigkeit, Mittenrauwert", "rugosité", "rugosidad, rugosidad media"),
    _role("Rz", "maximum height of profile", "um", "surface", "roughness depth",
          "Rautiefe, gemittelte Rautiefe"),
    _role("edge", "cutting edge", "", "label", "test, test no, test number, test id, test #, case, case no, "
          "edge no, edge number, edge id, edge #", "Schneide, Schneidkante, Schneidennr, Schneide Nr, "
          "Versuch, Versuchsnr, Versuch Nr, Versuchsnummer",
          "arête, arête de coupe, essai, essai no, numéro d'essai",
          "filo, filo de corte, ensayo, ensayo no"),
    _role("tool", "tool", "", "label",
          "insert, cutting tool, tool material, tool grade, insert grade, cutter, milling cutter, end mill, drill",
          "Werkzeug, Schneidstoff, Wendeschneidplatte, Schneidplatte, Platte, Fräser, Schaftfräser, Bohrer",
          "outil, outil de coupe, plaquette, fraise, foret", "herramienta, plaquita, inserto, fresa, broca"),
    _role("work", "work material", "", "label", "workpiece, workpiece material, material",
          "Werkstoff, Werkstück, Werkstückstoff", "matière, matériau, pièce", "pieza, material de la pieza"),
    _role("run", "run order", "", "label", "run no, run number, run #, standard order, std order",
          "Lauf, Laufnr, Lauf Nr, Reihenfolge", "ordre, ordre de passage", "corrida, orden"),
    _role("censored", "run-out", "", "label",
          "censoring, censor, cens, right censored, runout, suspended, suspension, survived, not failed, no failure",
          "zensiert, abgebrochen, Abbruch, Durchläufer, nicht ausgefallen, Kriterium nicht erreicht",
          "censuré, interrompu, critère non atteint", "censurado, interrumpido, suspendido, criterio no alcanzado"),
    _role("ended", "end of life reached", "", "label",
          "failed, failure event, event, event observed, worn out, life ended, end of life, criterion reached",
          "ausgefallen, Ausfall, Standzeitende, Standzeitende erreicht, Kriterium erreicht, verschlissen",
          "défaillance, usé, critère atteint", "falla, fallo, desgastado, criterio alcanzado"),
)
# fmt: on

ROLES: Mapping[str, Role] = {role.symbol: role for role in _TABLE}
"""Symbol -> role, in the order of tables and messages."""

# Names of several quantities: an adjacent symbol or the unit decides, otherwise the first.
_SHARED: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("f", "feed", "Vorschub", "avance"), ("f", "fm", "fz")),
    **dict.fromkeys(("fm", "vf", "feed rate", "feed speed"), ("fm", "f")),
    **dict.fromkeys(("Vorschubgeschwindigkeit", "vitesse d'avance", "velocidad de avance"), ("fm", "f")),
    **dict.fromkeys(("speed", "Geschwindigkeit", "vitesse", "velocidad"), ("V", "n")),
    "F": ("F", "fm"),  # F [mm/min], the feed word of a part program
    **dict.fromkeys(("force", "Kraft", "effort", "fuerza"), ("F", "Fx", "Fy", "Fz", "Fxz", "Fc", "Ff", "Fp")),
    **dict.fromkeys(("wear", "Verschleiß", "usure", "desgaste"), FLANK_WEAR),
    **dict.fromkeys(("roughness", "Rauheit", "rugosité", "rugosidad"), ("Ra", "Rz")),
    "FZ": ("Fz", "fz"),
    "T": ("T", "theta"),
}
# Letters that name a quantity only beside its unit: words of a part program, a radius.
_WITH_UNIT: Mapping[str, tuple[str, ...]] = {"S": ("n",), "N": ("n",), "r": ("re",), "R": ("re",)}
_MEAN = r"(?:mean|ave(?:rage)?\.?|avg\.?|Mittel(?:wert)?|moy(?:enne)?\.?|media|prom(?:edio)?\.?|measured|gemessen|ist)"
_OF_MEAN = re.compile(
    rf"{_MEAN}[\s_]++(?:of[\s_]++)?(?P<after>.+)|(?P<before>.*[^\s_,-])[\s_,-]+{_MEAN}", re.IGNORECASE
)
_CASED_PAIRS = ("fz", "Fz", "FZ")


def _key(name: str, umlauts: bool = True) -> str:
    """Bring a name to the form compared: no separators, accents or case; a lone letter keeps its case."""
    plain = re.sub(r"[\s_.,;:'’()\[\]{}-]", "", unicodedata.normalize("NFKC", name)).replace("#", "no")
    if len(plain) == 1 or plain in _CASED_PAIRS:
        return plain
    folded = plain.casefold()
    if umlauts:
        folded = folded.replace("ä", "ae").replace("ö", "oe").replace("ü", "ue")
    return "".join(c for c in unicodedata.normalize("NFD", folded) if not unicodedata.combining(c))


def _index() -> dict[str, tuple[str, ...]]:
    named = [*((name, (role.symbol,)) for role in _TABLE for name in role.names), *_SHARED.items()]
    plain = {_key(name, umlauts=False): roles for name, roles in named}
    return plain | {_key(name): roles for name, roles in named if not name.isascii()}


_BY_NAME: dict[str, tuple[str, ...]] = _index()


@lru_cache(maxsize=4096)
def _meanings(words: tuple[str, ...]) -> tuple[str, ...]:
    """Roles a run of words may name: as a whole, or as parts that agree, such as "cutting speed" and "Vc"."""
    whole = _BY_NAME.get(_key(" ".join(words)), ())
    if whole or not 1 < len(words) < 9:
        return whole
    for cut in range(1, len(words)):
        right = _meanings(words[cut:])
        if common := tuple(role for role in _meanings(words[:cut]) if role in right):
            return common
    return ()


def roles_named(name: str) -> tuple[str, ...]:
    """Symbols of all roles that a name may denote, the most likely first.

    >>> roles_named("feed")
    ('f', 'fm', 'fz')
    """
    return _meanings(tuple(word for word in re.split(r"[\s_()\[\]{},;:/=-]+", name) if word))


def understood_unit(symbol: str, unit: str) -> str | None:
    """Canonical unit of a column of this role, None when the unit is not listed.

    A bare length under a feed (f or fz in mm, as many write them) is understood per revolution or per tooth.

    >>> understood_unit("f", "mm"), understood_unit("fz", "um"), understood_unit("d", "mm")
    ('mm/rev', 'um/tooth', 'mm')
    """
    known = canonical(unit)
    if known in ("mm", "in", "um") and symbol in ("f", "fz"):
        return f"{known}/{'rev' if symbol == 'f' else 'tooth'}"
    return known


def fits(symbol: str, unit: str) -> bool:
    """Whether a listed unit is of the dimension of the role; a label has none."""
    role, known = ROLES[symbol], understood_unit(symbol, unit)
    if not role.unit or known is None:
        return known == "1"
    return known == role.unit or same_dimension(known, role.unit)


def role_of(name: str, unit: str | None) -> str | None:
    """Symbol of the role denoted by a column's name (without its unit), None when it is unknown.

    The unit decides between the roles of one name. If it fits none of them, the first is returned, so that the
    reader reports the unit, except where the letter denotes something else: V in volt, t in degC, z in mm, DC
    in A, Fn in N, ae in %, a label with a unit. None, "" or a spelling that is not listed is ignored.

    >>> role_of("Schnittgeschwindigkeit vc", "m/min"), role_of("feed", "mm/s"), role_of("V", "volt")
    ('V', 'fm', None)
    >>> role_of("AW", "N"), role_of("S", "rpm"), role_of("S", None), role_of("T", "°C"), role_of("Fn", "N")
    ('AW', 'n', None, 'theta', None)
    """
    known = unit is not None and is_unit(unit)
    found = roles_named(name) or (_WITH_UNIT.get(name.strip(), ()) if known else ())
    if not (found and unit and known):
        return found[0] if found else None
    fitting = [symbol for symbol in found if fits(symbol, unit)]
    if fitting or name.strip() in _WITH_UNIT:
        return fitting[0] if fitting else None
    other_thing = (
        (canonical(unit) in ("V", "mV", "A", "mA") and found[0] == "Dc")
        or (canonical(unit), found[0]) in (("N", "f"), ("kN", "f"), ("%", "ae"), ("%", "d"))
        or found[0] in ("z", "re", "theta", "kappa", "lead", "sigma")
        or (canonical(unit) in ("V", "mV", "degC") and found[0] in ("V", "T", "t"))
    )
    return None if other_thing or not ROLES[found[0]].unit else found[0]


def role_of_mean(name: str, unit: str | None) -> str | None:
    """Symbol of the response whose mean or measured value a column is named as, None for other names.

    >>> role_of_mean("Ra_mean", None), role_of_mean("average cutting force", "N"), role_of_mean("mean speed", None)
    ('Ra', 'Fc', None)
    """
    match = _OF_MEAN.fullmatch(name.strip())
    role = role_of(match["after"] or match["before"], unit) if match else None
    return role if role is not None and ROLES[role].kind in MEASURED else None


_PEAK = re.compile(
    r"(?:max\.?|maximum|peak|rms|Spitze|Spitzenwert|eff)[\s_]++(?:of[\s_]++)?(?P<after>.+)|"
    r"(?P<before>[^\s_]*[^\s_,-])[\s_,-]*(?:max\.?|maximum|peak|pk|rms|Spitze|Spitzenwert|eff)",
    re.IGNORECASE,
)


def role_of_peak(name: str, unit: str | None) -> str | None:
    """Symbol of the load whose peak or effective value a column is named as, None for other names.

    >>> role_of_peak("Fx max", "N"), role_of_peak("Fcmax", None), role_of_peak("T max", None)
    ('Fx', 'Fc', None)
    """
    match = _PEAK.fullmatch(name.strip())
    role = role_of((match["after"] or match["before"]).strip(), unit) if match else None
    return role if role is not None and ROLES[role].kind == "load" else None


# Units that name one quantity when they are the whole header, as US laboratories write them.
_BY_UNIT: Mapping[str, str] = {
    **dict.fromkeys(("m/min", "m/s", "sfm"), "V"),
    **dict.fromkeys(("mm/rev", "in/rev"), "f"),
    **dict.fromkeys(("mm/tooth", "in/tooth", "um/tooth"), "fz"),
    **dict.fromkeys(("mm/min", "mm/s", "in/min"), "fm"),
    **dict.fromkeys(("1/min", "rev/s"), "n"),
    **dict.fromkeys(("kW", "hp", "PS"), "P"),
    **dict.fromkeys(("mm3/min", "cm3/min", "in3/min"), "MRR"),
}


def role_of_unit(text: str) -> str | None:
    """Symbol of the role of a column whose whole header is a unit, None for other texts and units of several roles.

    >>> role_of_unit("SFM"), role_of_unit("IPR"), role_of_unit("mm")
    ('V', 'f', None)
    """
    unit = canonical(text) if text else None
    return _BY_UNIT.get(unit) if unit is not None else None


_WORDS = re.compile(r"[^\W\d_]?[^\W\d_A-ZÄÖÜ]+|[A-ZÄÖÜ]+(?![^\W\d_A-ZÄÖÜ])")  # of Speed_set, FeedSet, VBleft
_PARTIAL: Mapping[str, str] = {
    "flank": "VB", "minutes": "t", "seconds": "t", "hours": "t", "minuten": "t", "sekunden": "t", "stunden": "t",
}  # fmt: skip


def role_within(name: str) -> str | None:
    """Symbol of the quantity that some words of a name denote, the longest first; None for labels and other names.

    >>> role_within("Speed_set"), role_within("DepthSet"), role_within("Flank (mean)"), role_within("remark")
    ('V', 'd', 'VB', None)
    """
    words = _WORDS.findall(name)
    for length in range(min(3, len(words)), 0, -1):
        for start in range(len(words) - length + 1):
            part = " ".join(words[start : start + length])
            found = roles_named(part) if len(part) > 1 else ()
            role = found[0] if found else _PARTIAL.get(part.casefold())
            if role is not None and ROLES[role].kind != "label":
                return role
    return None


@lru_cache(maxsize=1024)  # the files of a laboratory have the same headers
def suggest_role(name: str) -> str | None:
    """Symbol of the role whose name is most similar to an unknown name, None when none is.

    >>> suggest_role("Cuting speed"), suggest_role("Position")
    ('V', None)
    """
    if roles_named(name):
        return None
    words = [known for known in _BY_NAME if len(known) >= 4]
    near = closest(_key(name), words, cutoff=0.84)  # one error in four letters, two in twelve
    return _BY_NAME[near][0] if near else None
