"""Closes the answers while a diagnosis runs, in a way that also holds where everything runs as root.

File permissions do not stop root, so the answers leave the disk: they are encrypted under a key that exists only in
the memory of the runner, and the readable files are removed. The key is neither in a file nor in the environment of
the diagnosing process. A runner that is killed outright takes the key with it; nothing is lost, since an answer is a
pure function of its seed and is then drawn again.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

NAME = "answers.sealed"


def _stream(key: bytes, nonce: bytes, length: int) -> bytes:
    return hashlib.shake_256(b"stream" + key + nonce).digest(length)


def _tag(key: bytes, nonce: bytes, body: bytes) -> bytes:
    return hmac.new(key, nonce + body, hashlib.sha256).digest()


def _mixed(data: bytes, key: bytes, nonce: bytes) -> bytes:
    stream = np.frombuffer(_stream(key, nonce, len(data)), dtype=np.uint8)
    return (np.frombuffer(data, dtype=np.uint8) ^ stream).tobytes()


def encrypted(data: bytes, key: bytes) -> bytes:
    """``data`` under a fresh nonce, with a tag that shows any change."""
    nonce = secrets.token_bytes(32)
    body = _mixed(data, key, nonce)
    return nonce + _tag(key, nonce, body) + body


def decrypted(sealed: bytes, key: bytes) -> bytes:
    """The data again; a wrong key or a changed file is refused."""
    nonce, tag, body = sealed[:32], sealed[32:64], sealed[64:]
    if not hmac.compare_digest(tag, _tag(key, nonce, body)):
        raise ValueError("The sealed answers do not open with this key: they were changed, or sealed by another run.")
    return _mixed(body, key, nonce)


@contextmanager
def sealed(answers: Path) -> Iterator[None]:
    """Inside the block no answer of the folder can be read; afterwards the files are as they were."""
    key = secrets.token_bytes(32)
    texts = {path.name: path.read_text() for path in sorted(answers.glob("*.json"))}
    closed = answers / NAME
    closed.write_bytes(encrypted(json.dumps(texts).encode(), key))
    for name in texts:
        (answers / name).unlink()
    # The readable texts leave the memory as well: what a fork of this process would inherit is the key alone.
    del texts
    try:
        yield
    finally:
        for name, text in json.loads(decrypted(closed.read_bytes(), key)).items():
            (answers / name).write_text(text)
        closed.unlink()
