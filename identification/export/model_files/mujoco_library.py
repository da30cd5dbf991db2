# pyright: reportAttributeAccessIssue=false
"""Whether the MuJoCo that is installed can load a file again; one that is broken or too old is treated as absent."""

from __future__ import annotations

OLDEST = (3, 4)
"""Oldest version that has all functions needed to load a file again."""

_JOINT = '<worldbody><body><joint name="j"/><geom size="1"/></body></worldbody>'
_NEWER = (
    (
        "<dcmotor",
        '<dcmotor joint="j" motorconst="1e-9 0" resistance="1" cogging="0 1 0" ctrlrange="0 0"/>',
        "<dcmotor>",
    ),
    (" delay=", '<motor joint="j" delay="0.01" nsample="12" interp="linear"/>', "delay of an actuator"),
)
"""Features of newer versions: text that shows their use, an actuator with the feature, and its name."""


def mujoco_problem(text: str = "") -> str | None:
    """Why MuJoCo cannot load a file again, as the end of a sentence; None if it can.

    Args:
        text: Text of the MJCF, which may have elements that only newer versions read.
    """
    try:
        import mujoco
    except Exception as error:  # a library of the system that is missing raises OSError, a half installation anything
        return f"MuJoCo cannot be imported ({' '.join(str(error).split())})"
    version = str(getattr(mujoco, "__version__", "0"))
    if not hasattr(mujoco, "MjModel") or _numbers(version) < OLDEST:
        return f"MuJoCo {version} is older than 3.4 (pip install --upgrade mujoco)"
    for words, actuator, name in _NEWER:
        if words in text:
            try:
                mujoco.MjModel.from_xml_string(f"<mujoco>{_JOINT}<actuator>{actuator}</actuator></mujoco>")
            except ValueError:
                return f"MuJoCo {version} does not know the {name} in it (pip install --upgrade mujoco)"
    return None


def _numbers(version: str) -> tuple[int, ...]:
    """The first two numbers of a version."""
    parts = [*version.split("."), "0"][:2]
    return tuple(int(part) if part.isdigit() else 0 for part in parts)
