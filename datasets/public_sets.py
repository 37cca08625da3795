"""Public sets of measurements: description, licence, addresses, and the SHA-256 of every file.

A set with ``made`` was compiled or converted from published data, so that no address holds its files.
"""

from dataclasses import dataclass

GITHUB = "https://raw.githubusercontent.com"
SERVO = "nicolazande/camber-control/2a8a2dc8a60ccd5a59c29bf1f5062f33ce71c963/actuators/LinA/data"


@dataclass(frozen=True, slots=True)
class PublicFile:
    """A file of a set: name, SHA-256 of its bytes, and the address that holds these bytes, if any."""

    name: str
    sha256: str
    url: str = ""


@dataclass(frozen=True, slots=True)
class PublicSet:
    """A set: description, licence, files, and how it was made where it is not a copy."""

    what: str
    licence: str
    files: tuple[PublicFile, ...]
    made: str = ""


def _at(address: str, *files: tuple[str, str], path: str = "{}") -> tuple[PublicFile, ...]:
    """Files of a repository at one commit: name and SHA-256 of each; ``path`` gives its place, ``{}`` for the name."""
    return tuple(PublicFile(name, sha256, f"{GITHUB}/{address}/{path.format(name)}") for name, sha256 in files)


SETS = {
    "nasa_milling": PublicSet(
        "flank wear and spindle current of 167 face-milling runs, NASA Ames and UC Berkeley 2007",
        "open data of the US government; the mirrors state no licence",
        (PublicFile("nasa_mill_runs.csv", "0fe438de02c36930ebf8b73887241618fecfc4d46540f916eb7330c52a92cab7"),),
        made="put together from three public tables: mill.csv of "
        "github.com/Subhigupta/Anomaly-Detection-NASA-Milling-Dataset, sensor_saturation_audit.csv of "
        "github.com/qq17596053317-ai/sqtr-tool-wear-estimation and reference.csv of "
        "github.com/Anurag-144/Ai-driven-tool-wear-prediction-with-mlops-",
    ),
    "turning_forces": PublicSet(
        "forces and roughness of 54 turning runs on six rows each, Canal and Borille 2022",
        "none stated",
        _at(
            "shay-tham/turning/624a0a3ddc368f9500b060333f48368cf3454fd0",
            ("Exp1.csv", "8bf73b353a9e4f0c5268f24551af635095551023923989ca2962e7806699f37f"),
        ),
    ),
    "cnc_mill_current": PublicSet(
        "mean spindle and drive currents of 18 milling experiments, University of Michigan 2018",
        "none stated",
        (PublicFile("per_experiment_means.csv", "95ae157935a413cd189476693548749a0d80885a8514cdcdde3038cca46fb469"),),
        made="averaged from experiment_01.csv to experiment_18.csv of github.com/ejhusom/cnc_milling_tool_wear",
    ),
    "emps": PublicSet(
        "two runs of a ball-screw drive at 1 kHz, Janot, Gautier and Brunot 2019",
        "cite the Nonlinear System Identification Benchmarks, 2019; the mirror is Apache-2.0",
        (
            PublicFile("data_emps.csv", "231673054389d597fc613c1fb6d1a17801bced16003ba3139eaf352ff4b25137"),
            PublicFile("data_emps_pulses.csv", "ae7b33d062137a230cafb4b8030315a095e3f27645ee5a82970c5261b414186d"),
        ),
        made="converted from the MAT files at www.nonlinearbenchmark.org (EMPS), mirrored by "
        "github.com/forgi86/sysid-neural-continuous",
    ),
    "servo_sweep": PublicSet(
        "sine sweep and square wave of a servo axis at 10 ms",
        "none stated",
        tuple(
            PublicFile(f"LinA__{name}", sha256, f"{GITHUB}/{SERVO}/{name}")
            for name, sha256 in (
                (
                    "pp-sine-sweep-10mm-0.5Hz.txt",
                    "c0080803529fb32bdc2aa209af6147647c1b6915fd3b87c1ef2fbdac4c451965",
                ),
                (
                    "no-pp-square-wave-10mm-1Hz.txt",
                    "5b900d7005183dda2d61ab21ee0eec75ec883fdb30db2f34dab5a8c1439d57f7",
                ),
            )
        ),
    ),
    "daisy": PublicSet(
        "hair dryer and flexible robot arm of DaISy, KU Leuven",
        "free with citation: De Moor B.L.R., DaISy",
        _at(
            "robotsorcerer/FARNN/9cfb82f2b42a53a604dba66d0eab23243a9a21ae",
            ("dryer.dat", "adcb2f5a1d9e174d08dd49f7f037626745b5e69cbda0bc1e8dca2a7c687d4538"),
            ("robot_arm.dat", "4ee167a8a28ce0da868d1b42f6a2fe0c456ea0e56b60c70915bf6d4a2a933635"),
            path="data/{}",
        ),
    ),
    "nist_strd": PublicSet(
        "regression sets with certified values, NIST",
        "public domain (US government)",
        _at(
            "mathnet/mathnet-numerics/84e9432bc1e8a6b2ae7acd32cda4175abeaeaed1",
            ("DanWood.dat", "df57252533d8e86489dbe0495b93f76a7c568cd2484442a12d12451721c207fe"),
            ("Eckerle4.dat", "007c2b0674e1b06e040045f7c68566a5e5e5537d8c18e51dfdbe20b308a3a16d"),
            ("Filip.dat", "1e8cb9a4644b1c6a8b1038eb46c59543814fa2a8d1ca31cb833040a75bf6a151"),
            ("Longley.dat", "c58ef65a2699826d55f134ddef27d09b9fb6ab4499fdd49a408b4cd5a63dc890"),
            ("MGH09.dat", "7652a2f0128f47266fe65d9feeb852b9109d3e59346cf9240163db3fe4276975"),
            ("Misra1a.dat", "8679e2dd54906496437605a047f5de81677ab056bdc73cfa56374a230be72974"),
            ("Norris.dat", "cc3fd14d1c5fa891d5653000c9d7732c30db842cca49fc051abde1c19d67ab7d"),
            ("Thurber.dat", "dcf20ab4ddd93676ec993bb785675d378d97ebdbae8f37b884e8e68d30949bbc"),
            ("Wampler5.dat", "dd00873dea76a3adb0f7e01be4a9d96f368983cb4be1a89517963a24d3d12afa"),
            path="data/NIST/{}",
        ),
    ),
}
