"""The snippets of docs/large_work.md run as they stand. Oracles: known truth, and a log that is there twice."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest

from places import CHECKOUT

pytestmark = pytest.mark.whole


@pytest.fixture
def large_work(rubbing_pendulum, monkeypatch) -> list[str]:
    """The snippets of the page on large work, in a folder with the files that they name: one log under two names."""
    shutil.copy(rubbing_pendulum / "log.csv", rubbing_pendulum / "one.csv")
    shutil.copy(rubbing_pendulum / "log.csv", rubbing_pendulum / "two.csv")
    monkeypatch.chdir(rubbing_pendulum)
    return re.findall(r"```python\n(.*?)```", (CHECKOUT / "docs" / "large_work.md").read_text(), flags=re.DOTALL)


def test_the_page_on_large_work_diagnoses_each_log_on_dask(large_work):
    # Known truth: Coulomb friction on the pin. A scheduler of this process stands for that of the page.
    names = {}
    exec(large_work[0].replace('"scheduler:8786"', "processes=False, dashboard_address=None"), names)
    names["client"].close()
    assert {row.document["findings"][0]["effect"] for row in names["result"].rows} == {"coulomb_friction"}


def test_the_page_on_large_work_fits_logs_that_it_reads_one_by_one(large_work):
    # Closed form: a log that is there twice gives the estimate of one, with deviations smaller by the root of two.
    fits = []
    for snippet in (large_work[1], large_work[1].replace(', "two.csv"', "")):
        names = {}
        exec(snippet, names)
        fits.append(names["fit"])
    both, one = fits
    assert both.names == ("rod.mx", "rod.mz", "rod.Iyy")
    np.testing.assert_allclose(both.theta, one.theta)
    np.testing.assert_allclose(both.std() * np.sqrt(2), one.std(), rtol=1e-3)  # a degree of freedom less in one
