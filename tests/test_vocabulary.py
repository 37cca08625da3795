"""The vocabulary: headers of four languages and of published files are named, or left unknown."""

import pytest
from fitmodels.datasets.headers import Header, parse_header
from fitmodels.datasets.units import canonical
from fitmodels.datasets.vocabulary import ROLES, role_of, suggest_role, understood_unit
from hypothesis import given, settings
from hypothesis import strategies as st

# Headers of published files, written out: column -> role.
NASA_MILLING = {  # Agogino and Goebel, BEST lab, 2007: nasa_mill_runs.csv
    "case": "edge", "run": "run", "VB": "VB", "time": "t", "DOC": "d", "feed": "f", "material": "work",
    "smcDC_mid_mean": None, "smcDC_rail_ratio": None, "smcAC_mid_std": None, "smcDC_all_mean": None,
}  # fmt: skip
TURNING_FORCES = {  # Canal and Borille, 2022: Exp1.csv and exp1_runs.csv
    "Run_ID": None, "Experiment": None, "Replica": None, "Tool_ID": None, "Group": None, "Subgroup": None,
    "Position": None, "Condition": None, "TCond": None, "Machined_length": None, "Init_diameter": None,
    "Final_diameter": None, "CTime": None, "R_measurement": None, "ap": "d", "vc": "V", "f": "f", "Ra": "Ra",
    "Rz": "Rz", "Rsk": None, "Rku": None, "RSm": None, "Rt": None, "Fx": "Fx", "Fy": "Fy", "Fz": "Fz",
    "F": "F", "Ra_mean": None, "Ra_sd": None, "Rz_mean": None, "n_Ra": None,
}  # fmt: skip
CNC_MILL = {  # University of Michigan SMART lab, 2018: per_experiment_means.csv -> name, unit, role
    "exp": ("exp", "", None),
    "feed_mm_s": ("feed", "mm/s", "fm"),
    "clamp_bar": ("clamp", "bar", None),
    "worn": ("worn", "", None),
    "n_samples": ("n_samples", "", None),
    "S1_OutputPower_kW": ("S1_OutputPower", "kW", None),
    "S1_OutputPower_sd": ("S1_OutputPower_sd", "", None),
    "S1_CurrentFeedback_A": ("S1_CurrentFeedback", "A", None),
    "S1_CurrentFeedback_sd": ("S1_CurrentFeedback_sd", "", None),
    "X1_absCurrent_A": ("X1_absCurrent", "A", None),
    "Y1_absCurrent_A": ("Y1_absCurrent", "A", None),
}


@pytest.mark.parametrize(("column", "role"), [*NASA_MILLING.items(), *TURNING_FORCES.items()])
def test_columns_of_published_files(column, role):
    assert parse_header(column) == Header(column, "")
    assert role_of(column, None) == role


@pytest.mark.parametrize(("column", "reported"), CNC_MILL.items())
def test_columns_whose_units_hang_on_underscores(column, reported):
    header = parse_header(column)
    assert (header.name, header.unit_text, role_of(header.name, header.unit_text)) == reported


def test_the_feed_word_of_a_part_program_is_a_feed_rate_by_its_unit():
    assert [role_of("F", unit) for unit in ("mm/min", "N", None)] == ["fm", "F", "F"]


def test_no_suggestion_for_a_column_that_is_no_role():
    unknown = [name for name, role in {**NASA_MILLING, **TURNING_FORCES}.items() if role is None]
    assert {name: suggest_role(name) for name in unknown if suggest_role(name)} == {"CTime": "t"}


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("V", "V", ""),
        ("V [m/min]", "V", "m/min"),
        ("V (m/min)", "V", "m/min"),
        ("AW{mm}", "AW", "mm"),
        ("V\n[m/min]", "V", "m/min"),
        ("\ufeffV [m/min]", "V", "m/min"),
        ("VB_[mm]", "VB", "mm"),
        ("V []", "V", ""),
        ("V [furlong/min]", "V", "furlong/min"),
        ("Speed (furlong/min)", "Speed", "furlong/min"),
        ("Vc in m/min", "Vc", "m/min"),
        ("V, m/min", "V", "m/min"),
        ("VB: mm", "VB", "mm"),
        ("V / m/min", "V", "m/min"),
        ("V/m/min", "V", "m/min"),
        ("n / min⁻¹", "n", "min⁻¹"),
        ("F/N", "F", "N"),
        ("V_m_per_min", "V", "m/min"),
        ("V_m_min", "V", "m/min"),
        ("feed_mm_s", "feed", "mm/s"),
        ("feed_per_tooth_mm", "feed_per_tooth", "mm"),
        ("Fx_N", "Fx", "N"),
        ("P_kW", "P", "kW"),
        ("M_N_m", "M", "N m"),
        ("n_1_min", "n", "1/min"),
        ("t_min", "t", "min"),
        ("Force N", "Force", "N"),
        ("depth in", "depth", "in"),
        ("Schnittgeschwindigkeit vc [m/min]", "Schnittgeschwindigkeit vc", "m/min"),
        ("Cutting speed (Vc) [m/min]", "Cutting speed (Vc)", "m/min"),
        ("Cutting speed [m/min] (Vc)", "Cutting speed (Vc)", "m/min"),
        ("Speed (rpm)", "Speed", "rpm"),
        ("V [V]", "V", "V"),
        ("VB [in mm]", "VB", "in mm"),
    ],
)
def test_a_header_comes_apart(text, name, unit):
    assert parse_header(text) == Header(name, unit)


@pytest.mark.parametrize(
    "text",
    [
        "Ra_mean",
        "n_Ra",
        "Final_diameter",
        "V_min",  # a minimum, not minutes: V is no time
        "VB_max",
        "Load_min",
        "feed_per_min",
        "Group_A",
        "Edge A",
        "Test 1",
        "Fx (2)",
        "VB (mean)",
        "Cutting speed (Vc)",
        "Cutting speed (V)",
        "Cutting speed V",
        "Tool / Work",
        "U/min",
        "[mm]",
        "",
    ],
)
def test_a_tail_that_is_no_unit_stays(text):
    assert parse_header(text) == Header(text, "")


@pytest.mark.parametrize("symbol", ROLES)
def test_every_name_leads_to_its_role(symbol):
    role = ROLES[symbol]
    for name in role.names:
        assert role_of(name, role.unit) == symbol
        for spelled in {name, name.replace(" ", "_"), name.replace(" ", "-"), f" {name} "}:
            assert role_of(spelled, role.unit) == symbol
        if len(name) > 2:
            assert role_of(name.upper(), None) == role_of(name.lower(), None) == role_of(name, None)


@pytest.mark.parametrize("role", ROLES.values())
def test_roles_are_whole(role):
    assert role.unit == "" or canonical(role.unit) == role.unit
    assert (role.unit == "") == (role.kind == "label")
    assert len(set(role.names)) >= 2 or role.kind == "label"
    assert all(name == name.strip() != "" for name in role.names)


@pytest.mark.parametrize(
    ("pair", "roles"),
    [
        ("f F", "f F"),
        ("d D", "d D"),
        ("t T", "t T"),
        ("fz Fz", "fz Fz"),
        ("f_z F_z", "fz Fz"),
        ("V v", "V V"),
        ("n I", "n I"),
        ("P M", "P M"),
    ],
)
def test_case_decides_between_symbols(pair, roles):
    assert [role_of(name, None) for name in pair.split()] == roles.split()


@pytest.mark.parametrize("name", ["N", "i", "p", "m", "q", "X", "Tool_ID", "Run_ID", "Tool material work", ""])
def test_unknown_names(name):
    assert role_of(name, None) is None


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("vc", "V"),
        ("VC", "V"),
        ("v_c", "V"),
        ("a_p", "d"),
        ("AP", "d"),
        ("vb", "VB"),
        ("VB_max", "VB"),
        ("aw", "AW"),
        ("ra", "Ra"),
        ("fx", "Fx"),
        ("F_x", "Fx"),
        ("FZ", "Fz"),
        ("Cutting_Speed", "V"),
        ("cutting-speed", "V"),
        ("velocidad de corte", "V"),
        ("VITESSE DE COUPE", "V"),
        ("Freiflächenverschleiß", "VB"),
        ("Freiflaechenverschleiss", "VB"),
        ("Freiflachenverschleiss", "VB"),
        ("Freifla\u0308chenverschleiß", "VB"),  # a + combining diaeresis, as macOS writes it
        ("usure en depouille", "VB"),
        ("vitesse d’avance", "fm"),
        ("Test No.", "edge"),
        ("Edge #", "edge"),
        ("Versuch-Nr.", "edge"),
        ("arete", "edge"),
        ("Werkstück", "work"),
        ("pieza", "work"),
        ("Schneidstoff", "tool"),
        ("plaquita", "tool"),
        ("Cutting speed V", "V"),
        ("Cutting speed (Vc)", "V"),
        ("Schnittgeschwindigkeit vc", "V"),
        ("Schnitttiefe a_p (depth of cut)", "d"),
        ("Vorschub fz", "fz"),
        ("Fx (force)", "Fx"),
        ("Verschleiß VB", "VB"),
        ("Drehzahl n", "n"),
    ],
)
def test_names_without_a_unit(name, role):
    assert role_of(name, None) == role


@pytest.mark.parametrize("name", ["cutting speed f", "tool material work", "feed force F"])
def test_parts_that_disagree_are_unknown(name):
    assert role_of(name, None) is None


@pytest.mark.parametrize(
    ("name", "unit", "role"),
    [
        ("feed", "mm/rev", "f"),
        ("feed", "mm", "f"),
        ("feed", "ipr", "f"),
        ("feed", "mm/min", "fm"),
        ("feed", "mm/s", "fm"),
        ("feed", "mm/z", "fz"),
        ("f", "mm/min", "fm"),
        ("feed rate", None, "fm"),
        ("feedrate", "mm/rev", "f"),
        ("vf", "mm/min", "fm"),
        ("Vorschubgeschwindigkeit", "mm/U", "f"),
        ("speed", None, "V"),
        ("speed", "sfm", "V"),
        ("speed", "rpm", "n"),
        ("FZ", "N", "Fz"),
        ("FZ", "mm/tooth", "fz"),
        ("fz", "mm", "fz"),
        ("V", "volt", None),
        ("V", "furlong", "V"),  # an unlisted unit tells nothing here; the reader complains of it by name
        ("I", "V", "I"),  # no role else: the reader says that the unit does not fit
        ("T", "°C", "theta"),
        ("T", "min", "T"),
        ("temperature", "°F", "theta"),
        ("Re", "MPa", None),
        ("r", "mm", "re"),
        ("N", "rpm", "n"),
        ("d", "mm/rev", "d"),
        ("wear", "um", "AW"),
        ("flank wear", "um", "VB"),
        ("force", "lbf", "F"),
        ("power", "hp", "P"),
        ("current", "mA", "I"),
        ("torque", "N m", "M"),
        ("Q", "cm³/min", "MRR"),
        ("edge", "-", "edge"),
        ("material", "HB", None),
    ],
)
def test_the_unit_decides(name, unit, role):
    assert role_of(name, unit) == role


@pytest.mark.parametrize(
    ("symbol", "unit", "understood"),
    [
        ("f", "mm", "mm/rev"),
        ("f", "inch", "in/rev"),
        ("fz", "mm", "mm/tooth"),
        ("d", "mm", "mm"),
        ("f", "mm/min", "mm/min"),
        ("f", "furlong", None),
    ],
)
def test_a_bare_length_under_a_feed(symbol, unit, understood):
    assert understood_unit(symbol, unit) == understood


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("Cuting speed", "V"),
        ("Schnitgeschwindigkeit", "V"),
        ("Cuting speed (Vc)", "V"),
        ("dept of cut", "d"),
        ("Werkzeg", "tool"),
        ("flankwaer", "VB"),
        ("V", None),  # known: nothing to suggest
        ("Rt", None),
        ("Coolant", None),
        ("Operator", None),
        ("", None),
    ],
)
def test_near_misses(name, role):
    assert suggest_role(name) == role


@settings(deadline=None)
@given(
    st.sampled_from([role for role in ROLES.values() if role.unit not in ("", "1")]),
    st.sampled_from(["{} [{}]", "{} ({})", "{}{{{}}}", "{} in {}", "{}, {}", "{} / {}", "{}\n[{}]"]),
)
def test_symbol_and_unit_come_back_from_every_form(role, form):
    header = parse_header(form.format(role.symbol, role.unit))
    assert header == Header(role.symbol, role.unit)
    assert role_of(header.name, header.unit_text) == role.symbol


@settings(deadline=None)
@given(st.text(max_size=20))
def test_any_text_is_a_header(text):
    header = parse_header(text)
    assert header.unit_text == "" or header.name
    assert role_of(header.name, header.unit_text) in (None, *ROLES)
    assert suggest_role(header.name) in (None, *ROLES)
