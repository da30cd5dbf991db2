from pathlib import Path

import numpy as np
import pytest

from identification.data.readers.read_table import read_table
from identification.export.log_and_map_files import write_log
from identification.files import LOG_ENDINGS
from phantom_dyn.errors import UsageError


@pytest.mark.parametrize("ending", LOG_ENDINGS)
def test_a_log_comes_back_as_it_was_written(tmp_path, rng, ending):
    columns = {"t": np.arange(60) / 10.0, "q.a": rng.standard_normal(60), "tau.a": rng.standard_normal(60)}
    write_log(tmp_path / f"log{ending}", columns)
    back = read_table(tmp_path / f"log{ending}").columns
    assert list(back) == list(columns)
    for name, values in columns.items():
        np.testing.assert_array_equal(back[name], values)


def test_an_ending_that_names_no_format_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"log\.bag ends in \.bag, wanted a log that ends in \.csv, \.npz, \.parquet"):
        write_log(Path(tmp_path) / "log.bag", {"t": np.arange(3.0)})
