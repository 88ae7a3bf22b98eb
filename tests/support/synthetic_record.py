"""A data set as a lab might leave it, from formulas alone: SYNTHETIC, its tables are not the paper's."""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from support.matlab_bytes import classic, objects, record, records, timeseries
from tendonrepro.configuration.published import coupling_of, published, table_1

Array = NDArray[np.float64]

S, S_INV = coupling_of(table_1(published()))
STEP, STROKE, REST = 0.002, 2.0, 1.0
PERIOD = 2.0 * (STROKE + REST)
TIME = STEP * np.arange(round(2.0 * PERIOD / STEP) + 1)
COUNT = 360.0 / 16384.0
# Size of the error in degrees; the printed order holds on neither joint.
SIZES = {
    "controller_1": (0.42, 0.51),
    "controller_2": (0.36, 0.47),
    "controller_3": (0.39, 0.33),
    "controller_1_payload": (0.55, 0.49),
}


def desired(joint: int) -> Array:
    """Minimum-jerk strokes up and down with rests, deg."""
    phase = np.mod(TIME, PERIOD)
    up, down = (np.clip((phase - start) / STROKE, 0.0, 1.0) for start in (0.0, STROKE + REST))
    stroke = [x**3 * (10.0 - 15.0 * x + 6.0 * x**2) for x in (up, down)]
    return (10.0 + 8.0 * joint) * (stroke[0] - stroke[1])


def measured(run: str, joint: int) -> Array:
    """Encoder reading in deg: behind the motion, with an oscillation, in whole counts."""
    size = SIZES[run][joint - 2]
    rate = np.gradient(desired(joint), STEP)
    lag = size * (rate / np.abs(rate).max() + 0.6 * np.sin(2.0 * np.pi * 0.9 * TIME + joint))
    return COUNT * np.round((desired(joint) - lag) / COUNT)


def errors(run: str) -> Array:
    """Tracking error of joints 2 and 3, deg, (T, 2)."""
    return np.stack([desired(joint) - measured(run, joint) for joint in (2, 3)], axis=1)


def joints_and_motors() -> tuple[Array, Array]:
    """Encoders and winches of the decoupling experiment, deg, each (T, 3)."""
    q = np.stack([desired(1), desired(2), desired(3)], axis=1)
    stretch = np.array([0.02, 0.05, 0.09]) * np.sin(2.0 * np.pi * TIME / PERIOD)[:, np.newaxis]
    return COUNT * np.round(q / COUNT), (q + stretch) @ S_INV.T


def columns(run: str) -> dict[str, Array]:
    table = {"Time (s)": TIME}
    for joint in (2, 3):
        table[f"Joint {joint} desired (deg)"] = desired(joint)
        table[f"Joint {joint} actual (deg)"] = measured(run, joint)
    return table


def workbook(table: Mapping[str, Array]) -> bytes:
    import openpyxl

    book = openpyxl.Workbook()
    book.properties.title = "SYNTHETIC"
    sheet = book.active
    assert sheet is not None
    sheet.title = "Sheet1"
    sheet.append(list(table))
    for row in np.stack(list(table.values()), axis=1).tolist():
        sheet.append(row)
    stream = io.BytesIO()
    book.save(stream)
    return stream.getvalue()


def separated(table: Mapping[str, Array]) -> bytes:
    """Text as a German or Chinese spreadsheet saves it: semicolons, decimal commas."""
    stream = io.StringIO()
    writer = csv.writer(stream, delimiter=";")
    writer.writerow(table)
    for row in np.stack(list(table.values()), axis=1).tolist():
        writer.writerow([f"{value:.6f}".replace(".", ",") for value in row])
    return stream.getvalue().encode()


def make_record(folder: Path) -> dict[str, bytes]:
    """Write the files of the record, key -> content.

    Controller 1 is a MATLAB file of timeseries, Controller 2 a struct with time, Controller 3 and the payload
    run are workbooks in an archive, the decoupling experiment is a text with decimal commas.
    """
    folder.mkdir(parents=True, exist_ok=True)
    one = {
        f"q{joint}{name}": timeseries(angle, TIME, name=f"q{joint}{name}", unit="deg")
        for joint in (2, 3)
        for name, angle in (("", measured("controller_1", joint)), ("_des", desired(joint)))
    }
    objects(folder / "SYNTHETIC controller1.mat", one, "v7")
    qd = np.stack([desired(2), desired(3)], axis=1)
    signals = records(
        {"values": qd, "dimensions": 2.0, "label": "qd"},
        {"values": qd - errors("controller_2"), "dimensions": 2.0, "label": "q"},
    )
    log = record(time=TIME[:, np.newaxis], signals=signals, blockName="SYNTHETIC/Scope")
    classic(folder / "SYNTHETIC_controller2.mat", {"logs": log}, packed=True)
    with zipfile.ZipFile(folder / "SYNTHETIC_comparison.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for run, name in (("controller_3", "controller3"), ("controller_1_payload", "controller1_0.2kg")):
            archive.writestr(f"xlsx/SYNTHETIC_{name}.xlsx", workbook(columns(run)))
    q, motors = joints_and_motors()
    table = {"t": TIME} | {f"joint {k + 1} (deg)": q[:, k] for k in range(3)}
    table |= {f"motor {k + 1} (deg)": motors[:, k] for k in range(3)}
    (folder / "SYNTHETIC_decoupling.csv").write_bytes(separated(table))
    (folder / "README.txt").write_text("SYNTHETIC data made by tests; nobody has measured this.\n")
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def expected_sizes() -> dict[str, dict[str, Array]]:
    """Table 2 and the payload row of this record, deg, joints 2 and 3."""
    return {
        run: {"mae": np.abs(errors(run)).mean(axis=0), "rmse": np.sqrt((errors(run) ** 2).mean(axis=0))}
        for run in SIZES
    }
