"""Mutations of files of arrays: NPZ and Parquet whose columns have other kinds, shapes, lengths, names and values."""

import io
import random
import warnings
import zipfile

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from fuzz_mutations import mutated_bytes
from fuzz_values import TEXTS, float_value

_KINDS = ("f2", "f4", ">f8", "i1", "u8", "c16", "bool", "U5", "S3", "M8[ns]", "m8[s]", "g")
_HUGE = ((2**40,), (2**62, 2**62), (10**9, 8), (-1,), (3, 0), ())


def mutated_columns(rng: random.Random, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns with one or several of them changed in kind, shape, length, name or values."""
    out = {name: values.copy() for name, values in columns.items()}
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for _ in range(rng.choice((1, 1, 2))):
            _change(rng, out)
    return out


def _no_axis(values: np.ndarray) -> np.ndarray:
    return values.reshape(-1)[:1].reshape(()) if values.size else values


def _change(rng: random.Random, out: dict[str, np.ndarray]) -> None:
    if not out:
        return
    name = rng.choice(sorted(out))
    values, kind = out[name], rng.randrange(10)
    if kind == 0 and values.dtype.kind not in "USM":  # of text and dates not every other kind can be made
        out[name] = values.astype(rng.choice(_KINDS))
    elif kind == 1 and values.ndim:
        out[name] = rng.choice((values[:, None], values[:0], values[:-1], values[::2], _no_axis(values)))
    elif kind == 2:
        del out[name]
    elif kind == 3:
        out[rng.choice((*TEXTS, "q.", "t.x", "f.tip.x", "v.pin", "i.pin"))] = out.pop(name)
    elif kind == 4 and values.size:
        flat = values.reshape(-1)
        flat[rng.randrange(flat.size)] = float_value(rng) if values.dtype.kind == "f" else flat[0]
    elif kind == 5 and values.dtype.kind == "f":
        out[name] = np.full_like(values, float_value(rng))
    elif kind == 6 and values.dtype.kind == "f":
        out[name] = values * rng.choice((1e-300, 1e-9, 1e4, 1e305, -1.0, 0.0))
    elif kind == 7 and values.dtype.kind == "f":
        out[name] = values + rng.choice((1e5, 1e9, 1e15, -1e3))
    elif kind == 8 and values.ndim:
        out[name] = values[::-1]
    else:
        out[name] = np.random.default_rng(rng.randrange(9)).normal(size=values.shape)


def mutated_npz(rng: random.Random, columns: dict[str, np.ndarray]) -> bytes:
    """An NPZ file: wrong arrays, a name twice, a shape that is declared and not there, wrong bytes."""
    sink = io.BytesIO()
    (np.savez_compressed if rng.random() < 0.5 else np.savez)(sink, **_named(mutated_columns(rng, columns)))
    kind = rng.random()
    if kind < 0.25:
        return mutated_bytes(rng, sink.getvalue())
    if kind < 0.45:
        with warnings.catch_warnings(), zipfile.ZipFile(sink, "a", zipfile.ZIP_DEFLATED) as archive:
            warnings.simplefilter("ignore")  # a name that is there already
            archive.writestr(rng.choice(("t.npy", "extra.npy", "note.txt", "../up.npy")), _declared(rng))
    return sink.getvalue()


def _named(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name.replace("\0", "") or "empty": values for name, values in columns.items() if "/" not in name}


def _declared(rng: random.Random) -> bytes:
    """An array file whose header declares more than follows."""
    shape, kind = rng.choice(_HUGE), rng.choice(("'<f8'", "'|O'", "'<M8[ns]'", "[('a', '<f8')]", "'|V9'", "'x'"))
    head = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    head += b" " * (63 - (len(head) + 10) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + b"\0" * rng.choice((0, 80, 4800))


def mutated_parquet(rng: random.Random, columns: dict[str, np.ndarray]) -> bytes:
    """A Parquet file: wrong columns and kinds, missing values, a name twice, wrong bytes."""
    changed = {name: values for name, values in mutated_columns(rng, columns).items() if values.ndim == 1}
    length = min((len(values) for values in changed.values()), default=0)
    arrays = [_arrow(rng, values[:length]) for values in changed.values()]
    names = list(changed)
    if names and rng.random() < 0.1:
        names[-1] = names[0]
    sink = io.BytesIO()
    table = pa.Table.from_arrays(arrays, names=names)
    pq.write_table(table, sink, compression=rng.choice(("none", "snappy", "zstd")), use_dictionary=rng.random() < 0.5)
    return mutated_bytes(rng, sink.getvalue()) if rng.random() < 0.35 else sink.getvalue()


def _arrow(rng: random.Random, values: np.ndarray) -> pa.Array:
    """A column as Arrow's, at times of another kind."""
    if values.dtype.kind in "cg" or values.dtype.itemsize > 8 or values.dtype.kind not in "fiub":
        return pa.array([str(one) for one in values])
    array = pa.array(values.astype(values.dtype.newbyteorder("=")))
    kind = rng.randrange(12)
    if kind == 0:
        return pa.array([None if k % 7 == 3 else float(one) for k, one in enumerate(values)])
    if kind == 1:
        return pa.array([[float(one)] for one in values])
    if kind == 2:
        return pa.nulls(len(values))
    if kind == 3 and len(values):
        return pa.array([str(one) for one in values]).dictionary_encode()
    return array
