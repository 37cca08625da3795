"""The upload of a model repository in one commit, through huggingface_hub."""

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from ...core.errors import FitmodelsError, GateError, UsageError
from .hub import INSTALL, LIBRARY, HubRepository, endpoint, first_line, has_library, is_ours

if TYPE_CHECKING:
    from huggingface_hub import CommitOperationAdd, CommitOperationCopy, CommitOperationDelete, HfApi
    from huggingface_hub.errors import HfHubHTTPError

    CommitOperation = CommitOperationAdd | CommitOperationCopy | CommitOperationDelete

STATUS = {  # HTTP status -> what is wrong and the remedy
    401: "the token was rejected; log in again with: hf auth login, or set HF_TOKEN",
    402: "the hub wants a payment for this; leave --private out, or choose another name than {name}",
    403: "the token is not allowed to write there; use one with write access to {name}",
    404: "there is no such account or repository, or the token does not see it; check the name {name}",
    409: "another change of the repository is in progress; run again in a minute",
    412: "the repository changed during the upload; check its files, then run again",
    413: "the files are too large for the hub; leave --data out",
    429: "too many requests; run again in some minutes",
}


@dataclass(frozen=True, slots=True)
class HubCommit:
    """Result of an upload.

    Attributes
    ----------
    url : str
        Of the commit.
    created : bool
        The repository is new.
    unchanged : bool
        It had the same files already.
    removed : tuple of str
        Files of a former upload that were removed.
    remarks : tuple of str
        Warnings of the hub about the front matter.
    """

    url: str
    created: bool
    unchanged: bool
    removed: tuple[str, ...]
    remarks: tuple[str, ...]

    def facts(self) -> dict[str, Any]:
        """The upload for programs."""
        return asdict(self)


def push(repository: HubRepository, *, private: bool = False, force: bool = False) -> HubCommit:
    """Upload a repository in one commit, with the token of huggingface_hub.

    Parameters
    ----------
    repository : HubRepository
    private : bool
        Whether a new repository is private.
    force : bool
        Replace the files of a repository that fitmodels wrote; of another, nothing is ever replaced.

    Raises
    ------
    GateError
        The repository has obstacles.
    UsageError
        huggingface_hub or a token is missing, or the repository exists.
    FitmodelsError
        The hub refused, or the connection was lost.
    """
    if repository.obstacles:
        raise GateError(f"{repository.name}: was not uploaded: {' '.join(repository.obstacles)}")
    if not has_library():
        raise UsageError(f"--push: needs the package huggingface_hub; install it with: {INSTALL}.")
    from huggingface_hub import HfApi, get_token

    _mute()
    with _hub_errors(repository.name), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if not get_token():
            raise UsageError(f"no token for {endpoint()}; log in with: hf auth login, or set HF_TOKEN.")
        api = HfApi()
        created, parent, former = _target(api, repository.name, private=private, force=force)
        removed = tuple(path for path in former if is_ours(path) and path not in repository.files)
        operations = _operations(repository, removed)
        commit = api.create_commit(repository.name, operations, commit_message=repository.message, parent_commit=parent)
    remarks = tuple(first_line(w.message) for w in caught if issubclass(w.category, UserWarning))
    return HubCommit(commit.commit_url, created, commit.oid == parent, removed, remarks)


def _operations(repository: HubRepository, removed: Iterable[str]) -> "list[CommitOperation]":
    """The files to add and those to delete, as the library wants them."""
    from huggingface_hub import CommitOperationAdd, CommitOperationDelete

    added = (CommitOperationAdd(path, content) for path, content in repository.files.items())
    return [*added, *map(CommitOperationDelete, removed)]


def _created(api: "HfApi", name: str, *, private: bool) -> bool:
    """Create the repository; False if it exists."""
    from huggingface_hub.errors import HfHubHTTPError

    try:
        api.create_repo(name, private=private)
    except HfHubHTTPError as error:
        if error.response.status_code == 409:
            return False
        raise
    return True


def _target(api: "HfApi", name: str, *, private: bool, force: bool) -> tuple[bool, str | None, list[str]]:
    """Whether the repository was created, its last commit, and its files; refused where it is not to be replaced."""
    if _created(api, name, private=private):
        return True, None, []
    info = api.model_info(name)
    files = [one.rfilename for one in info.siblings or [] if one.rfilename != ".gitattributes"]
    if private and not info.private:
        raise UsageError(f"{name} exists and is public; make it private in its settings, or leave --private out.")
    if not files:  # made by an upload that did not arrive
        return False, info.sha, files
    if info.card_data is None or info.card_data.get("library_name") != LIBRARY:
        raise UsageError(f"{name} exists and was not written by fitmodels; choose another name.")
    if not force:
        raise UsageError(f"{name} exists on {endpoint()}; replace its files with --force, or choose another name.")
    return False, info.sha, files


def _mute() -> None:
    """Switch off progress bars and log lines of the library: each failure is one sentence."""
    import logging

    from huggingface_hub.utils.tqdm import disable_progress_bars

    disable_progress_bars()
    logging.getLogger("huggingface_hub").setLevel(logging.ERROR)


def _refusal(error: "HfHubHTTPError", name: str) -> str:
    """Refusal of the hub, with the remedy and the HTTP status."""
    status = error.response.status_code
    if status in STATUS:
        return f"{STATUS[status].format(name=name)} (HTTP {status})"
    reason = first_line(error.server_message or "no reason given")
    return f"the hub failed: {reason}; run again later (HTTP {status})"


@contextmanager
def _hub_errors(name: str) -> Iterator[None]:
    """Failures of huggingface_hub as one sentence each, without its headers and addresses."""
    from huggingface_hub.errors import HfHubHTTPError, OfflineModeIsEnabled

    try:
        yield
    except (FitmodelsError, TypeError, AttributeError):  # one sentence already, or a defect
        raise
    except OfflineModeIsEnabled:
        raise UsageError("HF_HUB_OFFLINE is set; nothing was uploaded. Unset it, then run again.") from None
    except HfHubHTTPError as error:
        raise FitmodelsError(f"{endpoint()}: {_refusal(error, name)}; nothing was uploaded.") from None
    except ValueError as error:
        words = " ".join(str(error).split())
        if "README.md" not in words:
            words = "its answer is not that of a hub; check HF_ENDPOINT."
        raise FitmodelsError(f"{endpoint()}: {words} Nothing was uploaded.") from None
    except Exception as error:  # the classes of its HTTP library change with its version
        raise FitmodelsError(
            f"{endpoint()}: the connection failed ({type(error).__name__}); check HF_ENDPOINT and the network, then "
            "run again: an upload arrives whole or not at all."
        ) from None
