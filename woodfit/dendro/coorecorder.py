"""CooRecorder coordinate files (.pos): the points that a person clicks along a measurement path.

No grammar of the format is published; docs/formats.md gives the one that is read and written here. Frame: x right,
y down from the top of the image, mm, px * 25.4 / dpi with 0-based pixel centres. Points run from bark to pith.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

import numpy as np

from woodfit.dendro.path_widths import PathPoint, Point, ring_widths
from woodfit.dendro.series import FloatArray, FormatError, RingSeries
from woodfit.dendro.text import MAX_RINGS, error, excerpt, lines, parse_float, parse_int, parse_year

MM_PER_INCH = 25.4
MAX_POINTS = 20_000
MAX_COORDINATE_MM = 100_000.0
MAX_ZEROS = 1_000
MAX_KEYS_LENGTH = 10_000
FIRST_LINE = "#DENDRO (Cybis Dendro program compatible format) Coordinate file written as "

_TIME = re.compile(r"(.*) ([0-9]{4}-[0-9]{2}-[0-9]{2} [0-9]{2}:[0-9]{2}:[0-9]{2})")
_ZEROS = re.compile(r"ZERO([0-9]{1,6})(?:#(.*))?")
_KEY = re.compile(r"[A-Za-z][A-Za-z0-9]{0,40}")


@dataclass(frozen=True)
class MeasuredPath:
    """Contents of a coordinate file.

    Parameters
    ----------
    points : tuple of PathPoint
        From bark to pith, in the order of the file.
    image : str
        Path of the image.
    dpi : float or None
        Resolution that turned px into mm.
    dated : int or None
        Year of the outermost measured ring.
    comments : tuple of str
        Free text about the sample.
    keys : dict
        Values by name, for example ``{"DistanceToPith": "2.3"}``.
    written_as, written_at : str
        Path and time of the first line.
    """

    points: tuple[PathPoint, ...]
    image: str = ""
    dpi: float | None = None
    dated: int | None = None
    comments: tuple[str, ...] = ()
    keys: dict[str, str] = field(default_factory=dict)
    written_as: str = ""
    written_at: str = ""

    def key(self, name: str) -> str | None:
        """Value of a key, whose spelling changed in upper and lower case between versions."""
        return next((value for key, value in self.keys.items() if key.lower() == name.lower()), None)

    @property
    def pith_xy_mm(self) -> Point | None:
        """Position of the pith."""
        return _point(self.key("PithCoordinates") or "")

    @property
    def pith_distance_mm(self) -> float | None:
        """Distance from the innermost point to the pith."""
        return parse_float((self.key("DistanceToPith") or "").strip())

    @property
    def pith_years(self) -> int | None:
        """Estimated rings between the innermost point and the pith."""
        return parse_int((self.key("YearsToPith") or "").strip())

    def series(self, name: str) -> RingSeries:
        """Ring widths along the path, oldest first, with years from the date of the outermost ring.

        The width is the length of the way from the inner side of one ring border over the points between to the next
        border, without what lies between gap marks. A label becomes the remark of the ring whose outer border, or
        inside, it stands at; at the innermost border that of the last ring.
        """
        rings = ring_widths(self.points)[::-1]
        early = np.array([ring.earlywood_mm for ring in rings])
        late = np.array([ring.latewood_mm for ring in rings])
        any_wood = bool(np.isfinite(early).any())
        return RingSeries(
            name,
            np.array([ring.width_mm for ring in rings]),
            None if self.dated is None else self.dated - len(rings) + 1,
            early if any_wood else None,
            late if any_wood else None,
            remarks={index: "; ".join(ring.remarks) for index, ring in enumerate(rings) if ring.remarks},
            pith_distance_mm=self.pith_distance_mm,
            pith_years=self.pith_years,
        )


def mm_from_px(xy_px: FloatArray, dpi: float) -> FloatArray:
    """Coordinates of a file (mm) from those of the image (px, 0-based pixel centres)."""
    return np.asarray(xy_px, np.float64) * (MM_PER_INCH / dpi)


def px_from_mm(xy_mm: FloatArray, dpi: float) -> FloatArray:
    """Coordinates of the image (px, 0-based pixel centres) from those of a file (mm)."""
    return np.asarray(xy_mm, np.float64) * (dpi / MM_PER_INCH)


def loads(text: str, source: str = "text") -> MeasuredPath:
    """Read a coordinate file.

    Raises
    ------
    FormatError
        With line and reason; also when there are fewer than two ring borders.
    """
    rows = lines(text)
    if not rows[0].startswith("#DENDRO"):
        raise error(
            source, 1, excerpt(rows[0]), "'#DENDRO ...', the first line of a CooRecorder coordinate file",
            "other programs use .pos for other tables",
        )  # fmt: skip
    written = rows[0].split(" written as ", 1)[-1].strip() if " written as " in rows[0] else ""
    timed = _TIME.fullmatch(written)
    written_as, written_at = (timed[1], timed[2]) if timed else (written, "")
    image, dpi, dated = "", None, None
    comments: list[str] = []
    keys: dict[str, str] = {}
    points: list[PathPoint] = []
    for number, row in enumerate(rows[1:], 2):
        line = row.strip()
        if line.startswith("#Imagefile"):
            image = line[len("#Imagefile") :].strip()
        elif line.startswith("#DPI"):
            dpi = _dpi(line[len("#DPI") :].strip(), number, source)
        elif line == "#C DATED" or line.startswith("#C DATED "):
            year = line[len("#C DATED") :].strip()
            dated = parse_year(year, source, number) if year else None
        elif line.startswith("#C"):
            _read_comment(line[2:].strip(), comments, keys)
        elif line.startswith(("#All coordinates in", "SCALE")):
            if line not in ("#All coordinates in millimeters (mm)", "SCALE 1"):
                raise error(source, number, excerpt(line), "coordinates in millimeters and 'SCALE 1'")
        elif line and not line.startswith("#"):
            points.append(_read_point(line, number, source))
            if len(points) > MAX_POINTS:
                raise error(source, number, f"more than {MAX_POINTS} points", "fewer")
    borders = sum(point.kind == "border" for point in points)
    if borders < 2:
        raise error(source, None, f"{borders} ring borders", "at least two", "nothing was measured in this file")
    rings = borders - 1 + sum(point.zeros for point in points)
    if rings > MAX_RINGS:
        raise error(source, None, f"{rings} rings, absent ones included", f"at most {MAX_RINGS}")
    return MeasuredPath(tuple(points), image, dpi, dated, tuple(comments), keys, written_as, written_at)


def dumps(path: MeasuredPath) -> str:
    """Write a coordinate file, with coordinates to 0.0001 mm and lines ended by CR LF as CooRecorder writes them.

    Raises
    ------
    FormatError
        When a text would break its line, or there are fewer than two borders.
    """
    if sum(point.kind == "border" for point in path.points) < 2:
        raise FormatError("a coordinate file needs at least two ring borders; there is nothing to write")
    out = [FIRST_LINE + path.written_as + (f" {path.written_at}" if path.written_at else "")]
    out.append(f"#Imagefile {path.image}")
    if path.dpi is not None:
        out.append(f"#DPI {path.dpi!r}")
    out += ["#All coordinates in millimeters (mm)", "SCALE 1"]
    if path.dated is not None:
        out.append(f"#C DATED {path.dated}")
    for comment in path.comments:
        if comment != comment.strip() or not comment or comment.startswith("DATED") or _read_keys(comment):
            raise FormatError(f"the comment {comment!r} would not be read as a comment; reword it")
        out.append(f"#C {comment}")
    for key, value in path.keys.items():
        if _read_keys(f"{key}={value};") != {key: value}:
            raise FormatError(f"the value {key}={value!r} cannot be written; expected a plain name and no semicolon")
        out.append(f"#C {key}={value}; ")
    out += [_write_point(point) for point in path.points]
    broken = [line for line in out if "\n" in line or "\r" in line or "\0" in line]
    if broken:
        raise FormatError(f"a line break within {excerpt(broken[0])}; remove it")
    return "\r\n".join(out) + "\r\n"


def _dpi(token: str, number: int, source: str) -> float:
    dpi = parse_float(token)
    if dpi is None or not 1 <= dpi <= 1e6:
        raise error(source, number, f"the resolution {excerpt(token)}", "dots per inch, 1 to 1000000")
    return dpi


def _read_comment(text: str, comments: list[str], keys: dict[str, str]) -> None:
    found = _read_keys(text)
    if found:
        keys.update(found)
    elif text:
        comments.append(text)


def _read_keys(text: str) -> dict[str, str]:
    """``Key=value; Key=value; `` as a dictionary, empty when the text is of another kind."""
    if not text.rstrip().endswith(";") or len(text) > MAX_KEYS_LENGTH:
        return {}
    pairs = [part.strip().partition("=") for part in text.rstrip()[:-1].split(";")]
    if not all(sign and _KEY.fullmatch(key) for key, sign, _ in pairs):
        return {}
    return {key: value.strip() for key, _, value in pairs}


def _read_point(line: str, number: int, source: str) -> PathPoint:
    body, sign, mark = line.partition("#")
    positions = [_point(part) for part in body.removeprefix("D").split()]
    known = [position for position in positions if position is not None]
    if len(known) < len(positions) or not 1 <= len(known) <= (1 if body.startswith("D") else 2):
        raise error(
            source, number, excerpt(line), "a point such as '12.3456,7.8901 ' in mm, two of them for a shifted border,"
            " or 'D12.3456,7.8901 #W#' for the earlywood/latewood border",
        )  # fmt: skip
    if body.startswith("D"):
        if mark.startswith("W#"):
            return PathPoint(known[0], kind="latewood", label=mark[len("W#") :].removeprefix("#").strip())
        if mark.startswith("%gap"):
            return PathPoint(known[0], kind="gap", label=mark[len("%gap") :].removeprefix("#").strip())
        raise error(source, number, excerpt(line), "'#W#' or '#%gap' after a point that begins with D")
    zeros, label = 0, mark.strip() if sign else ""
    absent = _ZEROS.fullmatch(label)
    if absent:
        zeros, label = int(absent[1]), (absent[2] or "").strip()
        if zeros > MAX_ZEROS:
            raise error(source, number, f"{zeros} absent rings", f"at most {MAX_ZEROS}")
    return PathPoint(known[0], known[1] if len(known) > 1 else None, label=label, zeros=zeros)


def _point(text: str) -> Point | None:
    x, _, y = text.partition(",")
    xy = parse_float(x.strip()), parse_float(y.strip())
    if xy[0] is None or xy[1] is None or max(abs(xy[0]), abs(xy[1])) > MAX_COORDINATE_MM:
        return None
    return xy[0], xy[1]


def _write_point(point: PathPoint) -> str:
    label = point.label
    if label != label.strip() or (point.kind == "border" and _ZEROS.fullmatch(label)) or label.startswith("#"):
        raise FormatError(f"the label {label!r} would not be read as a label; reword it")
    if point.kind != "border":
        mark = {"latewood": "#W#", "gap": "#%gap"}[point.kind]
        return f"D{_write_xy(point.xy_mm)} {mark}" + (f"#{label}" if label else "")
    xy = _write_xy(point.xy_mm) + " "
    if point.second_xy_mm is not None:
        xy += f" {_write_xy(point.second_xy_mm)} "
    zeros = f"#ZERO{point.zeros}" if point.zeros else ""
    return xy + zeros + (f"#{label}" if label else "")


def _write_xy(xy: Point) -> str:
    if not all(math.isfinite(value) and abs(value) <= MAX_COORDINATE_MM for value in xy):
        raise FormatError(f"the point {xy} mm cannot be written; expected coordinates within ±{MAX_COORDINATE_MM:g} mm")
    return f"{xy[0]:.4f},{xy[1]:.4f}"
