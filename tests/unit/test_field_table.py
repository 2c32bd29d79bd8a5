"""CSV files as people and spreadsheets write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmfts.common import reading
from fmfts.common.names import field_columns
from fmfts_calibrate.field_table import DataError, read

HEADER = ",".join([*field_columns(1), "note"])


def written(folder: Path, text: str) -> Path:
    path = folder / "field.csv"
    path.write_text(text)
    return path


def test_byte_order_mark_is_no_part_of_the_first_column(tmp_path: Path) -> None:
    table = read(written(tmp_path, f"\ufeff{HEADER}\n1,2,3,a\n"), 1)
    np.testing.assert_array_equal(table.field_t, [[[1e-6, 2e-6, 3e-6]]])
    assert table.others == {"note": ["a"]}


def test_empty_cell_is_no_number(tmp_path: Path) -> None:
    assert np.isnan(read(written(tmp_path, f"{HEADER}\n1,,3,a\n"), 1).field_t[0, 0, 1])


@pytest.mark.parametrize(("row", "cells"), [("1,2", 2), ("1,2,3", 3), ("1,2,3,a,b", 5)])
def test_row_with_another_number_of_cells_is_named(tmp_path: Path, row: str, cells: int) -> None:
    path = written(tmp_path, f"{HEADER}\n1,2,3,a\n\n{row}\n")
    with pytest.raises(DataError, match=f"field.csv: row 4 has {cells} cells, the header 4"):
        read(path, 1)


def test_file_that_is_too_large_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, f"{HEADER}\n1,2,3,a\n")
    monkeypatch.setattr(reading, "LARGEST_TABLE", path.stat().st_size)
    assert len(read(path, 1).line) == 1
    monkeypatch.setattr(reading, "LARGEST_TABLE", path.stat().st_size - 1)
    with pytest.raises(DataError, match="larger than"):
        read(path, 1)
