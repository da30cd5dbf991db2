import hashlib
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import pytest

from identification.cli.main import main
from identification.data import datasets
from identification.data import datasets as download
from identification.data.datasets import Dataset, File
from phantom_dyn.errors import LogError, UsageError

CONTENT = b"t,q.j1,tau.j1\n0,0,0\n"
SHA256 = hashlib.sha256(CONTENT).hexdigest()


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@pytest.fixture(autouse=True)
def empty_cache(tmp_path, monkeypatch):
    """Neither the user's cache, nor the user's mirror, nor a proxy takes part."""
    monkeypatch.setattr(datasets, "cache_folder", lambda name: tmp_path / "cache" / name)
    for name in ("PHANTOM_DYN_DATA", "http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def server(tmp_path, monkeypatch):
    """Address of a server on this machine that has one file, a.csv."""
    folder = tmp_path / "served"
    folder.mkdir()
    (folder / "a.csv").write_bytes(CONTENT)
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()
    thread.join()


@pytest.fixture
def register(monkeypatch):
    """Make the registry hold one recording, `demo`, of one file."""

    def install(address, sha256=SHA256):
        file = File("a.csv", sha256, address)
        monkeypatch.setattr(datasets, "DATASETS", (Dataset("demo", "what", "licence", "http://page", "who", (file,)),))

    return install


def test_every_file_of_the_mirror_is_the_registered_one(data_folder, monkeypatch):
    # Oracle: the recordings themselves; `local` compares the hash of each file.
    monkeypatch.setenv("PHANTOM_DYN_DATA", str(data_folder))
    assert [datasets.local(name) for name in datasets.NAMES] == [data_folder / name for name in datasets.NAMES]


def test_the_mirror_holds_every_registered_recording(data_folder):
    # It may hold others beside them, which the registry does not offer.
    assert set(datasets.NAMES) <= {path.name for path in data_folder.iterdir() if path.is_dir()}


def test_a_pinned_commit_stands_in_every_address():
    addresses = [dataset.source for dataset in datasets.DATASETS]
    addresses += [file.address for dataset in datasets.DATASETS for file in dataset.files if file.address]
    assert all(
        any(set(part) <= set("0123456789abcdef") and len(part) >= 12 for part in a.split("/")) for a in addresses
    )


def test_nothing_is_local_without_mirror_and_cache():
    assert datasets.local("emps") is None


def test_an_unknown_name_lists_the_names_and_suggests_the_nearest():
    with pytest.raises(UsageError, match=r"unknown recording 'emp', wanted one of emps, ur10_unisa, .*mean emps\?"):
        datasets.fetch("emp")


def test_a_changed_file_in_the_mirror_is_refused(tmp_path, monkeypatch, register):
    register(None)
    (tmp_path / "demo").mkdir()
    (tmp_path / "demo" / "a.csv").write_text("something else")
    monkeypatch.setenv("PHANTOM_DYN_DATA", str(tmp_path))
    with pytest.raises(LogError, match=r"a\.csv has SHA-256 \w{12}\.\.\., wanted \w{12}\.\.\.: it was changed"):
        datasets.local("demo")


def test_a_public_file_is_downloaded_into_the_cache(server, register, tmp_path):
    register(f"{server}/a.csv")
    assert datasets.fetch("demo") == tmp_path / "cache" / "demo"
    assert (tmp_path / "cache" / "demo" / "a.csv").read_bytes() == CONTENT


def test_a_downloaded_recording_is_local_afterwards(server, register):
    register(f"{server}/a.csv")
    assert datasets.local("demo") is None
    assert datasets.fetch("demo") == datasets.local("demo")


def test_a_damaged_file_in_the_cache_is_fetched_again(server, register):
    register(f"{server}/a.csv")
    file = datasets.fetch("demo") / "a.csv"
    file.write_text("damaged")
    datasets.fetch("demo")
    assert file.read_bytes() == CONTENT


def test_a_file_with_another_hash_is_refused_and_not_kept(server, register, tmp_path):
    register(f"{server}/a.csv", sha256="0" * 64)
    with pytest.raises(LogError, match=r"could not fetch a\.csv of demo \(what came has another SHA-256\)"):
        datasets.fetch("demo")
    assert not list((tmp_path / "cache" / "demo").iterdir())


def test_a_missing_page_is_reported_with_the_servers_answer(server, register):
    register(f"{server}/gone.csv")
    with pytest.raises(LogError, match=r"could not fetch a\.csv of demo \(the server answered 404\)"):
        datasets.fetch("demo")


def test_without_a_connection_the_sentence_says_from_where_and_where_to(register):
    register("http://127.0.0.1:9/a.csv")  # nobody listens on the discard port
    wanted = (
        r"no connection to the server\): take it from http://127\.0\.0\.1:9/a\.csv and put a\.csv into DATA/demo, "
        "DATA being a folder of your own, and set PHANTOM_DYN_DATA=DATA"
    )
    with pytest.raises(LogError, match=wanted):
        datasets.fetch("demo")


def test_with_a_mirror_the_sentence_names_its_folder(register, tmp_path, monkeypatch):
    register("http://127.0.0.1:9/a.csv")
    monkeypatch.setenv("PHANTOM_DYN_DATA", str(tmp_path))
    with pytest.raises(LogError, match=f"put a.csv into {tmp_path / 'demo'}$"):
        datasets.fetch("demo")


def test_what_is_public_in_another_form_is_fetched_from_a_mirror_only(register):
    register(None)
    with pytest.raises(LogError, match="demo is published in another form at http://page and is fetched from a mirror"):
        datasets.fetch("demo")


def test_a_server_that_is_silent_is_left_after_the_given_time():
    never = threading.Event()
    with pytest.raises(TimeoutError, match=r"no answer within 0\.01 s"):
        download.with_timeout(0.01, never.wait)
    never.set()


def test_a_silent_server_is_left_within_ten_seconds():
    assert download.PATIENCE_S < 10


def test_an_error_of_the_job_comes_through():
    with pytest.raises(ZeroDivisionError):
        download.with_timeout(5.0, lambda: 1 / 0)


def test_list_names_licence_source_and_whereabouts_of_each(capsys):
    assert main(["datasets", "list"]) == 0
    text = capsys.readouterr().out
    assert all(f"{d.name}: {d.what}\n  licence  {d.licence}\n  source   {d.source}" in text for d in datasets.DATASETS)
    assert text.count("phantom-dyn datasets fetch") == sum(d.is_public for d in datasets.DATASETS)
    assert text.count("from a mirror only") == sum(not d.is_public for d in datasets.DATASETS)


def test_fetch_prints_the_folder(data_folder, monkeypatch, capsys):
    monkeypatch.setenv("PHANTOM_DYN_DATA", str(data_folder))
    assert main(["datasets", "fetch", "emps"]) == 0
    assert capsys.readouterr().out == f"{data_folder / 'emps'}\n"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["fetch"], "fetch needs a name, one of emps, ur10_unisa"),
        (["list", "emps"], "list takes no name, 'emps' was given"),
    ],
)
def test_fetch_needs_a_name_and_list_takes_none(capsys, words, said):
    assert main(["datasets", *words]) == 2
    assert said in capsys.readouterr().err
