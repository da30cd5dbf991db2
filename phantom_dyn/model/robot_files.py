"""Finds the file of a robot by its path, its built-in name or ``example:NAME``."""

from __future__ import annotations

from pathlib import Path

from phantom_dyn.errors import RobotError, known_names, nearest

_EXAMPLE = "example:"
_EXAMPLES_IN_PACKAGE = "cmeel.prefix/share/example-robot-data/robots"
_SUFFIXES = (".urdf", ".xml", ".mjcf")


def urdf_folder(package: Path = Path(__file__).parents[1]) -> Path | None:
    """Folder of the built-in robots: inside the installed package, or beside the packages in a checkout."""
    for folder in (package / "urdf", package.parent / "urdf"):
        if any(folder.glob("*/robot.*")):
            return folder
    return None


def builtin_robots() -> dict[str, Path]:
    """Robot file of each built-in name in `urdf_folder`, sorted by name."""
    folder = urdf_folder()
    if folder is None:
        return {}
    files = sorted(file for suffix in _SUFFIXES for file in folder.glob(f"*/robot{suffix}"))
    return {file.parent.name: file for file in files}


def examples_folder() -> Path | None:
    """Folder of the robots of example-robot-data, or None where it is not installed."""
    from importlib import metadata  # slow to import: it loads the standard library's mail modules

    try:
        located = metadata.distribution("example-robot-data").locate_file(_EXAMPLES_IN_PACKAGE)
    except metadata.PackageNotFoundError:
        return None
    folder = Path(str(located))
    return folder if folder.is_dir() else None


def find_example(name: str, folder: Path | None) -> Path:
    """Find a URDF of example-robot-data by its file name without the ending, with or without ``_robot``.

    An exact name takes precedence. Where several folders have a file of this name, ``FOLDER/NAME`` distinguishes them.

    Args:
        name: The text after ``example:``.
        folder: The robots of example-robot-data, None if it is not installed.

    Raises:
        RobotError: If the package is not installed, or the name is unknown or ambiguous.
    """
    if folder is None:
        raise RobotError(
            f"{_EXAMPLE}{name} needs the package example-robot-data, which is not installed: "
            "install it with pip install 'phantom-dyn[examples]'."
        )
    files = sorted(folder.rglob("*.urdf"))
    top, _, stem = name.rpartition("/")
    inside = [f for f in files if not top or f.relative_to(folder).parts[0] == top]
    for wanted in (stem, f"{stem}_robot", stem.removesuffix("_robot")):
        matches = [f for f in inside if f.stem == wanted]
        if len(matches) == 1:
            return matches[0]
        if matches:
            raise RobotError(_ambiguous(name, matches, folder))
    starting = [f for f in inside if stem and f.stem.startswith(stem)]
    if starting:
        raise RobotError(_ambiguous(name, starting, folder))
    known = known_names(stem, dict.fromkeys(f.stem for f in files), "examples")
    raise RobotError(f"There is no example robot {name!r}: {known}")


def _ambiguous(name: str, matches: list[Path], folder: Path) -> str:
    names = [f"{_EXAMPLE}{f.relative_to(folder).parts[0]}/{f.stem}" for f in matches]
    start = f"{_EXAMPLE}{name} is ambiguous" if len(names) > 1 else f"{_EXAMPLE}{name} is not the full name"
    return f"{start}: give one of {', '.join(names)}."


def looks_like_robot(word: str) -> bool:
    """Whether a word names a robot: an example, a built-in robot, or a file with the ending of a robot file."""
    return word.startswith(_EXAMPLE) or word.lower().endswith(_SUFFIXES) or word in builtin_robots()


def find_robot(source: str | Path) -> Path:
    """Find the existing file of a robot.

    Args:
        source: A URDF or MJCF file, ``example:NAME``, or a built-in name.

    Raises:
        RobotError: If there is no such robot; the message lists the names and suggests the most similar one.
    """
    text = str(source)
    if text.startswith(_EXAMPLE):
        return find_example(text.removeprefix(_EXAMPLE), examples_folder())
    path = Path(source)
    if path.is_file():
        return path
    builtin = builtin_robots()
    if text in builtin:
        return builtin[text]
    if path.is_dir():
        inside = sorted(f.name for f in path.iterdir() if f.suffix in _SUFFIXES)
        raise RobotError(f"{text} is a folder, wanted a robot file: {known_names('', inside, 'robot files in it')}")
    raise RobotError(_unknown(path, text, builtin))


def _example_named(name: str, folder: Path | None) -> str | None:
    """``example:NAME`` if ``name`` is a robot of example-robot-data (the user forgot ``example:``); otherwise None."""
    try:
        find_example(name, folder)
    except RobotError:
        return None
    return f"{_EXAMPLE}{name}"


def _unknown(path: Path, text: str, builtin: dict[str, Path]) -> str:
    """Message for a robot that was not found, with the most similar known name."""
    siblings = sorted(str(f) for f in path.parent.glob("*") if f.suffix in _SUFFIXES)
    folder = examples_folder()
    stems = {f.stem: f"{_EXAMPLE}{f.stem}" for f in folder.rglob("*.urdf")} if folder else {}
    built_in = ", ".join(builtin) or "none"
    start = f"There is no robot file {text!r}, and no built-in robot of that name (built-in: {built_in}"
    guess = _example_named(text, folder)
    if guess is None:
        short = nearest(text, [*siblings, *builtin, *stems])
        guess = stems.get(short, short) if short else None
    hint = f"did you mean {guess}?" if guess else "give a URDF or MJCF file."
    return f"{start}; robots of example-robot-data: {_EXAMPLE}NAME): {hint}"
