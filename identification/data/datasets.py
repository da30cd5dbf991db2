"""Public recordings of real robots: their list, and functions that find or download them.

A recording is looked for in three places: in the folder named by the environment variable ``PHANTOM_DYN_DATA`` (one
folder per recording), in the cache, and at its public address. The SHA-256 of every file is checked. The libraries for
downloading (pooch, requests, rich) are imported inside functions, as they take long to load and are seldom needed.
"""

from __future__ import annotations

import difflib
import hashlib
import os
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, cast

from phantom_dyn.errors import LogError, UsageError

T = TypeVar("T")

PATIENCE_S = 8.0
"""Longest wait for a server's first answer [s], including the look-up of its address, which has no limit of its own."""
CHUNK = 1 << 16
"""Bytes that are written to disk at a time."""


@dataclass(frozen=True)
class File:
    """One file of a recording; ``address`` is None if the file is published in another format only."""

    name: str
    sha256: str
    address: str | None = None


@dataclass(frozen=True)
class Dataset:
    """A recording of a real robot.

    Attributes:
        name: Name of the recording and of its folder.
        what: Description in one line.
        licence: Licence of the data, or of the repository that publishes them.
        source: Public page at the commit that was used.
        citation: Whom to cite.
        files: Files of its folder.
    """

    name: str
    what: str
    licence: str
    source: str
    citation: str
    files: tuple[File, ...]

    @property
    def is_public(self) -> bool:
        """Whether every file can be downloaded from a public address; if not, a mirror is needed."""
        return all(file.address for file in self.files)


DATASETS: tuple[Dataset, ...] = (
    Dataset(
        name="emps",
        what="ball-screw axis, 1 joint, 24.8 s at 1 kHz",
        licence="Apache-2.0 (repository); the data are a public benchmark",
        source="https://github.com/forgi86/sysid-neural-continuous/tree/956aa7ecd730/examples/EMPS/data",
        citation="Janot, Gautier, Brunot, Workshop on Nonlinear System Identification Benchmarks, 2019",
        files=(
            File(
                "DATA_EMPS.mat",
                "6cf6814ae14618795da0101aae2bb97ff0c6351b0501b5492751b02b07facf7e",
                "https://github.com/forgi86/sysid-neural-continuous/raw/956aa7ecd730/examples/EMPS/data/DATA_EMPS.mat",
            ),
        ),
    ),
    Dataset(
        name="ur10_unisa",
        what="UR10 arm, 6 joints, exciting trajectory, 27.5 s at 125 Hz",
        licence="BSD-3-Clause",
        source="https://github.com/unisa-acg/inverse-dynamics-solver/tree/41e196de5ca3",
        citation="Petrone, Ferrentino, Chiacchio, IEEE TII 2025, doi 10.1109/TII.2025.3534415",
        files=(
            File(
                "ur10_exciting_trajectory.db3",
                "14244fc39e9b42047039824f3c20ab984f9d1b28d5a67e9415cc1b3cc0ac3369",
                "https://github.com/unisa-acg/inverse-dynamics-solver/raw/41e196de5ca3/"
                "ur10_inverse_dynamics_solver/bagfiles/ur10_exciting_trajectory.db3",
            ),
        ),
    ),
    Dataset(
        name="tx40",
        what="Staubli TX40 arm, 6 joints with a coupled wrist, exciting trajectory, 7.1 s at 1 kHz",
        licence="Apache-2.0",
        source="https://github.com/thanhndv212/figaroh-examples/tree/c0b5c7f0fda1/examples/staubli_TX40",
        citation="figaroh-examples, identification of the Staubli TX40",
        files=(
            File("log.csv", "fef9e81c7ba76e3c1012257efa0a75f322a4b9226eae62cc7084d90713cb036c"),
            File("robot.urdf", "3d00cbd46279c915d594b1bb4610dbac78d1e99ed27f95de70984bde13486074"),
        ),
    ),
    Dataset(
        name="panda_gaz2019",
        what="Franka Panda, 7 joints with torque sensors, exciting trajectory, 21 s at 1 kHz",
        licence="GPL-3.0",
        source="https://github.com/marcocognetti/FrankaEmikaPandaDynModel/tree/44f1ec8a6155/matlab/data/Exciting_Traj",
        citation="Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca, IEEE RA-L 2019",
        files=(
            File("log.npz", "8fe9d1a12a9203924d08c7594763bacf1454dbe5e926e3f2abb9bd1ddab148e8"),
            File("robot.urdf", "63792d2679f22c4e41cda2c4d9d903644e628970ad0656b9eec8485113941555"),
            File("robot.yaml", "b4307d1e97390f783aa9a1e34e993fe8c2e75d5dd813c171511025691ffaabc2"),
        ),
    ),
    Dataset(
        name="go1_pendulum",
        what="Unitree Go1 leg drive with a pendulum of 0, 1 and 2 kg, 3 runs of 6 s at 62.5 Hz",
        licence="none stated in the fork; Apache-2.0 upstream",
        source="https://github.com/rimim/bam/tree/38071b19081a/example_data/data_raw_go1",
        citation="rimim, fork of Rhoban/bam; Duclusaud et al., ICRA 2025, arXiv 2410.08650",
        files=(
            File("sin_sin_0kg.csv", "baa99c6bd49520f0404ed368c4f45b8ab1a0329cf766e370d5326e28ffe28e97"),
            File("sin_sin_1kg.csv", "cf893c5bee4581db99045ee3bcf35452a0420d8f9f5622c317449542cb7b04b9"),
            File("sin_sin_2kg.csv", "74d6def0f1eb2a000ccbd21f66378516a30f99cbe34e31c29c7eb096aff039b9"),
            File("robot.urdf", "345dbcc4b52bedf865765cd434a1573c5a2f4e0b2f6fbdff0ac7911358181c71"),
            File("robot.yaml", "cf3fbab18938123ea0f40ed698a11deb3c66a64a1280a9c76e2a63a47e371bae"),
        ),
    ),
    Dataset(
        name="dfki_double_pendulum",
        what="double pendulum with two 6:1 drives, designs C.0 and C.1, 19 runs of 6-10 s at 500 Hz",
        licence="BSD-3-Clause",
        source="https://github.com/dfki-ric-underactuated-lab/double_pendulum/tree/1e8544e67f3d/data/experiment_records",
        citation="DFKI Underactuated Lab, double_pendulum",
        files=(
            File("C0_sysid.npz", "add3bbdcf291affbdbb6c7d1ef1a4fc053e95cdb3d669a729eebef3e23f4afa2"),
            File("C1_sysid.npz", "4c3a7563bd1ed099d41671a5e4ccabcf168469b8a795f7ee92a2fd8e7486bf48"),
            File("C1_model.urdf", "2e62b7a1232354c08240164dbf6a48d8fa4505aef91c12f94b8017af36a136db"),
            File("design_C1_identified.urdf", "a4f56327e8248e3014105bf467242a84c42239ef21d41a9ca04df04238bf274c"),
        ),
    ),
    Dataset(
        name="bam_xl330",
        what="Dynamixel XL330 servo with a pendulum, 8 runs of 6 s at 190 Hz",
        licence="Apache-2.0",
        source="https://github.com/Rhoban/bam/tree/af2260462471ff45ac18af159b1327ea51d8db15/bam/data.bak/raw",
        citation="Duclusaud et al., ICRA 2025, arXiv 2410.08650",
        files=(
            File("bam_xl330.npz", "7eeafccc17c0844869cbb036c5c09e8056dd2ab1178e4e74f1f2cf29f3839329"),
            File("runs.json", "8e3f24e1eda7313106b5f25332954ab8f3e6b4ee84c049055f4e402b72ddb26d"),
        ),
    ),
    Dataset(
        name="odrive_cogging",
        what="brushless motor on an ODrive: cogging maps, slow runs, spin-ups, with and without compensation",
        licence="MIT",
        source="https://github.com/gchenfc/ODrive/tree/54611550c141fb024b663d1d17fc98dc2c5b7fd3/analysis/cogging_torque",
        citation="G. Chen, ODrive fork, analysis of cogging torque",
        files=(
            File("cogging_maps.npz", "6406870af2b550a0390c9db1bd7c5c00846d63cf5886a638cf0d2bd0f4332b9f"),
            File("slow_and_pull.npz", "87a6e4a31a8237e2db72c2a40a2e1178fea82afc4db51fb188b25204ce18381d"),
            File("spinup.npz", "8a62a8f2fc7a69c2759afae742d9ed9045bf674d6039f8596268a0d7b78d528e"),
        ),
    ),
    Dataset(
        name="robonine_backlash",
        what="STS3215 and STS3250 servos on a backlash stand, 3 runs of 27-40 s at 10 Hz",
        licence="CC-BY-4.0 (hardware and documents)",
        source="https://github.com/roboninecom/Measuring-Backlash-in-Popular-UART-Servos/tree/5273b56230f3/logs",
        citation="Zenodo 19261714",
        files=(
            File("nocomp2.csv", "14067ce8b01614dd06b57710f584133dcb76413dab9bea765dc52e99753f27d8"),
            File("single.csv", "73ccfcde66feb26917a520fd722ee773a20d5923fa97f8da0b9c4c513e796443"),
            File("single_3250.csv", "63a9492014942a64e1b218177af129a0bbb903d7b2ad07eca3012cedfeadfd36"),
        ),
    ),
    Dataset(
        name="sage_so101",
        what="SO-101 arm of six hobby servos, 8 motions at 50 Hz, position only",
        licence="Apache-2.0",
        source="https://github.com/isaac-sim2real/sage/tree/4ffd2627df9d23e279b35712a67e629ce0c0dfa7/output/real/so101",
        citation="isaac-sim2real/sage",
        files=(File("so101.npz", "3ebc8c56d643d015c3e23160972519d730b67a8a121dd1dfd20dc5834e1c1a7e"),),
    ),
)

NAMES: tuple[str, ...] = tuple(dataset.name for dataset in DATASETS)


def find(name: str) -> Dataset:
    """The dataset with this name.

    Raises:
        UsageError: If there is none; the message lists all names and the nearest one.
    """
    for dataset in DATASETS:
        if dataset.name == name:
            return dataset
    nearest = difflib.get_close_matches(name, NAMES, n=1)
    hint = f"; did you mean {nearest[0]}?" if nearest else ""
    raise UsageError(f"unknown recording {name!r}, wanted one of {', '.join(NAMES)}{hint}")


def local(name: str) -> Path | None:
    """Folder on this machine that holds the recording, or None; nothing is downloaded.

    Raises:
        UsageError: If the name is unknown.
        LogError: If a file in the folder of ``PHANTOM_DYN_DATA`` does not have the SHA-256 of the list.
    """
    dataset = find(name)
    root = os.environ.get("PHANTOM_DYN_DATA")
    if root and all((Path(root) / name / file.name).is_file() for file in dataset.files):
        for file in dataset.files:
            _check(Path(root) / name / file.name, file)
        return Path(root) / name
    cached = cache_folder(name)
    intact = ((cached / file.name).is_file() and _sha256(cached / file.name) == file.sha256 for file in dataset.files)
    return cached if all(intact) else None


def fetch(name: str) -> Path:
    """Folder that holds the recording, which is downloaded into the cache if it is not on this machine yet.

    Raises:
        UsageError: If the name is unknown.
        LogError: If the download fails; the message says where to get the files and where to put them.
    """
    dataset = find(name)
    folder = local(name)
    if folder is not None:
        return folder
    if not dataset.is_public:
        raise LogError(
            f"{name} is published in another form at {dataset.source} and is fetched from a mirror only: "
            f"{_where_to_put(dataset)}"
        )
    folder = cache_folder(name)
    for file in dataset.files:
        assert file.address is not None
        try:
            download(file.address, folder / file.name, file.sha256)
        except (OSError, ValueError) as error:  # no network, no such page, a full disk, another hash
            raise LogError(
                f"could not fetch {file.name} of {name} ({error}): take it from {file.address} and "
                f"{_where_to_put(dataset)}"
            ) from error
    return folder


def cache_folder(name: str) -> Path:
    """Folder of the cache for a downloaded recording, which may not exist yet."""
    import pooch

    return Path(pooch.os_cache("phantom-dyn")) / name


def _check(path: Path, file: File) -> None:
    """Raise an error if the content of a file is not the listed one."""
    found = _sha256(path)
    if found != file.sha256:
        raise LogError(
            f"{path} has SHA-256 {found[:12]}..., wanted {file.sha256[:12]}...: it was changed or is another version; "
            "replace it by the original"
        )


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _where_to_put(dataset: Dataset) -> str:
    """Advice on the folder into which a user puts the files by hand."""
    root = os.environ.get("PHANTOM_DYN_DATA")
    names = ", ".join(file.name for file in dataset.files)
    if root:
        return f"put {names} into {Path(root) / dataset.name}"
    return f"put {names} into DATA/{dataset.name}, DATA being a folder of your own, and set PHANTOM_DYN_DATA=DATA"


def download(address: str, path: Path, sha256: str) -> None:
    """Download the file at ``address`` to ``path``; no file is left there if its hash is not ``sha256``.

    Raises:
        OSError: If the address does not answer, or the file cannot be written.
        ValueError: If the file has another hash.
    """
    import pooch

    pooch.get_logger().setLevel("WARNING")  # by default Pooch prints a line for every download
    try:
        pooch.retrieve(
            address,
            known_hash=f"sha256:{sha256}",
            fname=path.name,
            path=path.parent,
            downloader=cast("Any", _to_file),
        )
    except ValueError as error:
        raise ValueError("what came has another SHA-256") from error


def _to_file(url: str, output_file: str, _: object) -> None:
    """Write the content of ``url`` to a file; Pooch calls this function with these three arguments."""
    import requests

    try:
        response = with_timeout(PATIENCE_S, lambda: requests.get(url, stream=True, timeout=PATIENCE_S / 2))
        if not response.ok:
            raise OSError(f"the server answered {response.status_code}")
        size = int(response.headers.get("content-length", 0))
        with Path(output_file).open("wb") as out:
            for chunk in _with_progress(response.iter_content(CHUNK), size, Path(url).name):
                out.write(chunk)
    except requests.RequestException as error:
        raise OSError("no connection to the server") from error


def with_timeout(seconds: float, job: Callable[[], T]) -> T:
    """Result of ``job``, or an error if the job takes longer than ``seconds``.

    The job runs in a thread, because the look-up of a host's address cannot be interrupted otherwise.

    Raises:
        TimeoutError: After ``seconds``.
    """
    results: list[T] = []
    errors: list[Exception] = []

    def work() -> None:
        try:
            results.append(job())
        except Exception as error:
            errors.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(seconds)
    if errors:
        raise errors[0]
    if not results:
        raise TimeoutError(f"no answer within {seconds:g} s")
    return results[0]


def _with_progress(chunks: Iterator[bytes], size: int, label: str) -> Iterator[bytes]:
    """The same chunks; while they are read, a terminal on standard error shows a progress bar."""
    if not sys.stderr.isatty():
        yield from chunks
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(label, total=size or None)
        for chunk in chunks:
            progress.advance(task, len(chunk))
            yield chunk
