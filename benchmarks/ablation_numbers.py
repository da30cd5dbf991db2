"""Find the named numbers of packages, give one another value, and follow where a number could change a comparison.

A named number is a constant of a module in capital letters that is a number or a tuple of numbers. While a program
runs, a `Followed` stands for the number: it also computes each result with half and with twice the number, until a
comparison would turn out otherwise. If no comparison does, the run gives the same answer with half and with twice the
number.
"""

from __future__ import annotations

import ast
import operator
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

import numpy as np

CHECKOUT = Path(__file__).resolve().parents[1]
FACTORS = (0.5, 2.0)  # factors by which a number is multiplied
_NEARLY_ALL = 0.9  # a share or probability from here on is a strict limit, whose distance to one is scaled
Value = float | int | tuple


@dataclass(frozen=True)
class Named:
    """A named number: module, name, value, and the unit in the comment above it."""

    module: str
    name: str
    value: Value
    unit: str

    @property
    def key(self) -> str:
        """Module and name, which identify the number."""
        return f"{self.module}:{self.name}"


def named_numbers(folders: Sequence[str], root: Path = CHECKOUT) -> tuple[Named, ...]:
    """All named numbers of the modules in some folders of a checkout."""
    out: list[Named] = []
    for path in sorted(file for folder in folders for file in (root / folder).rglob("*.py")):
        text = path.read_text()
        module = ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")
        for statement in ast.parse(text).body:
            for name, value in _assigned(statement):
                out.append(Named(module, name, value, _unit(text.splitlines(), statement.lineno - 1)))
    return tuple(out)


def _assigned(statement: ast.stmt) -> Iterator[tuple[str, Value]]:
    """Names in an assignment statement of a module, and the numbers that it assigns."""
    if isinstance(statement, ast.Assign) and len(statement.targets) == 1:
        target, value = statement.targets[0], statement.value
    elif isinstance(statement, ast.AnnAssign) and statement.value is not None:
        target, value = statement.target, statement.value
    else:
        return
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple) and len(target.elts) == len(value.elts):
        pairs = list(zip(target.elts, value.elts, strict=True))
    else:
        pairs = [(target, value)]
    for one, of_it in pairs:
        number = _number(of_it)
        if isinstance(one, ast.Name) and one.id.isupper() and number is not None:
            yield one.id, number


def _number(node: ast.expr) -> Value | None:
    """The number or tuple of numbers of a literal expression, or None."""
    if isinstance(node, ast.Tuple):
        parts = [_number(part) for part in node.elts]
        return tuple(parts) if parts and None not in parts else None
    literal = all(
        isinstance(one, ast.BinOp | ast.UnaryOp | ast.operator | ast.unaryop)
        or (isinstance(one, ast.Constant) and type(one.value) in (int, float))
        for one in ast.walk(node)
    )
    return eval(compile(ast.Expression(node), "", "eval"), {}) if literal else None  # only literals


def _unit(lines: Sequence[str], at: int) -> str:
    """The unit that begins the comment above a line, such as ``share`` of ``# share: of the gap``."""
    first = at
    while first > 0 and lines[first - 1].startswith("#"):
        first -= 1
    words = lines[first].removeprefix("#").split(":")[0].strip() if first < at else ""
    return words if len(words) <= 24 else ""


def scaled(value: Value, factor: float) -> Value:
    """A number halved or doubled; an integer stays an integer, and above zero if it was.

    Of a probability such as 0.99, the distance to one is doubled or halved, because there is no probability of 1.98.
    """
    if isinstance(value, tuple):
        return tuple(scaled(part, factor) for part in value)
    if isinstance(value, float) and _NEARLY_ALL <= value < 1.0:
        return 1.0 - (1.0 - value) / factor
    return max(round(value * factor), min(value, 1)) if isinstance(value, int) else value * factor


def modules_with(named: Named) -> list[ModuleType]:
    """Loaded modules that contain a named number: the one that defines it, and those that import it."""
    home = sys.modules[named.module]
    value = getattr(home, named.name)
    packages = {named.module.split(".")[0], "identification", "phantom_dyn"}
    return [
        module
        for name, module in list(sys.modules.items())
        if name.split(".")[0] in packages and vars(module).get(named.name) is value
        if module is home or _imports(module, named)
    ]


def _imports(module: ModuleType, named: Named) -> bool:
    source = getattr(module, "__file__", None)
    if not source:
        return False
    return any(
        isinstance(node, ast.ImportFrom) and node.module == named.module and named.name in {a.name for a in node.names}
        for node in ast.parse(Path(source).read_text()).body
    )


def replace_number(named: Named, value: object) -> None:
    """Give a named number another value in every module that contains it, for the rest of this process."""
    for module in modules_with(named):
        setattr(module, named.name, value)


@dataclass
class Trace:
    """What was recorded of each followed number.

    Attributes:
        asked: Number of comparisons that involved a number, by its key.
        flips: How many of these have another result with half and with twice the number.
        lost: How often a number was used where it cannot be followed, such as in an array.
        places: For each line of code, how often the comparisons of a number gave False and True.
    """

    asked: dict[str, int] = field(default_factory=dict)
    flips: dict[str, list[int]] = field(default_factory=dict)
    lost: dict[str, int] = field(default_factory=dict)
    places: dict[str, dict[str, list[int]]] = field(default_factory=dict)

    def compared(self, key: str, came_out: tuple[bool, bool], otherwise: Sequence[bool]) -> None:
        """Count a comparison.

        Args:
            key: Key of a number in the comparison.
            came_out: Whether the result contains False, and whether it contains True.
            otherwise: Whether the result differs with half and with twice the number.
        """
        self.asked[key] = self.asked.get(key, 0) + 1
        seen = self.places.setdefault(key, {}).setdefault(_line(), [0, 0])
        for k, so in enumerate(came_out):
            seen[k] += so
        known = self.flips.setdefault(key, [0, 0])
        for k, differs in enumerate(otherwise):
            known[k] += differs

    def gone(self, keys: Sequence[str]) -> None:
        """Count that these numbers cannot be followed further."""
        for key in keys:
            self.lost[key] = self.lost.get(key, 0) + 1


def _line() -> str:
    """File and line of the code that uses a followed number."""
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename == __file__:
        frame = frame.f_back
    return f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}"


class Followed:
    """A number, with the values that it would have if some named numbers were halved or doubled.

    It is not a ``float``, so that a conversion to a float is noticed. After a conversion it counts as lost.
    """

    __slots__ = ("others", "trace", "value")
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, value: float, others: dict[str, tuple[float, ...]], trace: Trace) -> None:
        self.value, self.others, self.trace = value, others, trace

    def _lose(self) -> float:
        self.trace.gone(list(self.others))
        return self.value

    def __float__(self) -> float:
        return float(self._lose())

    def __int__(self) -> int:
        return int(self._lose())

    def __index__(self) -> int:
        return operator.index(self._lose())  # type: ignore[arg-type]

    def __bool__(self) -> bool:
        return bool(self._lose())

    def __round__(self, digits: int | None = None) -> float:
        return round(self._lose(), digits)

    def __repr__(self) -> str:
        return repr(self._lose())

    def __format__(self, spec: str) -> str:
        return format(self._lose(), spec)

    def __array__(self, dtype: object = None, copy: object = None) -> np.ndarray:
        return np.array(self._lose(), dtype=dtype)  # type: ignore[call-overload]

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: object, **options: object) -> object:
        plain = [one.value if isinstance(one, Followed) else one for one in inputs]
        simple = ufunc in _COMPARISONS or all(np.ndim(one) == 0 for one in plain)  # type: ignore[arg-type]
        if method == "__call__" and simple and not options:
            return _combined(ufunc, *inputs)
        for one in (*inputs, *options.values()):
            for part in one if isinstance(one, tuple) else (one,):
                if isinstance(part, Followed):
                    part._lose()
        return getattr(ufunc, method)(*plain, **options)

    def __array_function__(self, function: Callable, types: object, given: tuple, options: dict) -> object:
        def plain(one: object) -> object:
            if isinstance(one, tuple | list):
                return type(one)(plain(part) for part in one)
            return one._lose() if isinstance(one, Followed) else one

        return function(*(plain(one) for one in given), **{name: plain(one) for name, one in options.items()})


_COMPARISONS = (np.greater, np.less, np.greater_equal, np.less_equal, np.equal, np.not_equal)


def _combined(of: Callable, *inputs: object) -> object:
    """Result of an operation with followed numbers; a comparison is counted and gives a plain bool."""
    followed = [one for one in inputs if isinstance(one, Followed)]
    trace = followed[0].trace

    def result(key: str | None, k: int) -> object:
        def one(given: object) -> object:
            if not isinstance(given, Followed):
                return given
            return given.others[key][k] if key in given.others else given.value

        return of(*(one(given) for given in inputs))

    base = result(None, 0)
    keys = list(dict.fromkeys(key for one in followed for key in one.others))
    if isinstance(base, bool | np.bool_) or (isinstance(base, np.ndarray) and base.dtype == bool):
        came_out = (not np.all(base), bool(np.any(base)))
        for key in keys:
            trace.compared(key, came_out, [bool(np.any(result(key, k) != base)) for k in range(len(FACTORS))])
        return base
    others = {key: tuple(result(key, k) for k in range(len(FACTORS))) for key in keys}
    return Followed(base, others, trace)  # type: ignore[arg-type]


def _add_operators() -> None:
    for name in ("add", "sub", "mul", "truediv", "floordiv", "mod", "pow"):
        of = getattr(operator, name)
        setattr(Followed, f"__{name}__", lambda self, other, of=of: _with_arrays(of, self, other))
        setattr(Followed, f"__r{name}__", lambda self, other, of=of: _with_arrays(of, other, self))
    for name in ("lt", "le", "gt", "ge", "eq", "ne", "neg", "pos", "abs"):
        of = getattr(operator, name)
        setattr(Followed, f"__{name}__", lambda *given, of=of: _combined(of, *given))


def _with_arrays(of: Callable, one: object, other: object) -> object:
    """Follow an operation on scalars; in an operation with an array, the number is lost."""
    if any(isinstance(x, list | tuple | str) or np.ndim(getattr(x, "value", x)) > 0 for x in (one, other)):  # type: ignore[arg-type]
        return of(*(x._lose() if isinstance(x, Followed) else x for x in (one, other)))
    return _combined(of, one, other)


_add_operators()


def followed(named: Named, trace: Trace) -> object:
    """The object that replaces a named number while a run is followed."""

    def of(value: float, at: Sequence[float]) -> Followed:
        return Followed(value, {named.key: tuple(at)}, trace)

    if not isinstance(named.value, tuple):
        return of(named.value, [scaled(named.value, factor) for factor in FACTORS])  # type: ignore[misc]
    every = [scaled(named.value, factor) for factor in FACTORS]
    flat = all(not isinstance(part, tuple) for part in named.value)
    if not flat:
        return named.value
    return tuple(of(part, [one[k] for one in every]) for k, part in enumerate(named.value))  # type: ignore[index]


def plain(value: object) -> object:
    """The plain value of a followed number, for values that are only written to files."""
    return value.value if isinstance(value, Followed) else value
