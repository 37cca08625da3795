"""The posterior part of the main job: its options, and what is kept when somebody stops it."""

import argparse
import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..fit.bayes.posterior import Posterior


def draw_options(p: argparse.ArgumentParser) -> "argparse._ArgumentGroup":
    """Options that say how the posterior of each law is drawn, and their group."""
    group = p.add_argument_group("uncertainty by draws")
    group.add_argument("--seed", type=int, metavar="N", help="of the draws (default: 1)")
    group.add_argument("--draws", type=int, metavar="N", help="how many (default: 4000)")
    group.add_argument("--priors", metavar="FILE", help='TOML file, or "reference": flat (default: weak, proper)')
    student = "errors with heavy tails, for odd rows or edges"
    group.add_argument("--student", action="store_true", default=None, help=student)
    return group


def posterior_options(p: argparse.ArgumentParser) -> None:
    """The same, and what is looked at besides."""
    group = draw_options(p)
    verify = "check every posterior by chains of another kind (some seconds a law)"
    group.add_argument("--verify", action="store_true", default=None, help=verify)
    pictures = "four pictures of each posterior too: marginals, pairs, by edge, curves"
    group.add_argument("--posterior-figures", action="store_true", default=None, help=pictures)


def checked(args: argparse.Namespace) -> dict[str, Any]:
    """What a result depends on besides the words of the command: the content of a priors file."""
    from ..core.errors import UsageError
    from ..fit.bayes.priors_file import read_priors

    if args.seed is not None and not 0 <= args.seed < 2**32:
        raise UsageError(f"--seed {args.seed}: it lies between 0 and {2**32 - 1}.")
    if args.priors is None or args.priors in ("weak", "reference"):
        return {}
    read_priors(args.priors)
    return {"priors_sha256": hashlib.sha256(Path(args.priors).read_bytes()).hexdigest()}


def kept(posteriors: "Sequence[Posterior]", folder: Path | None) -> str:
    """Keep draws of an interrupted run beside the folder that is not written, and say where."""
    from ..parameters import draws_of

    if folder is None or not any(post.sample.interrupted for post in posteriors):
        return ""
    folder.parent.mkdir(parents=True, exist_ok=True)
    path = folder.parent / f"{folder.name}.draws-so-far.npz"
    path.write_bytes(draws_of(posteriors))
    return f" The draws so far are in {path}."
