#!/usr/bin/env python3
"""Prints every kind of board with `nelu3d board`, renders the pages with `pdftoppm -r 600`, measures them, and finds them
with OpenCV.

    python3 -m venv /tmp/venv && /tmp/venv/bin/pip install opencv-contrib-python-headless
    apt-get install poppler-utils
    /tmp/venv/bin/python benches/board/check.py target/release/nelu3d

For each board: corners that OpenCV found of those there are, and the largest error of any distance between neighboring
corners (a side) and of any corner's place, in mm. Ends with exit code 1 where a corner is missing or a side is off by
more than 0.05 mm. Several sheets are laid together as their marks say before they are looked at.
"""
import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import cv2
import numpy as np

DPI = 600
MM = 25.4 / DPI
LIMIT_MM = 0.05
BOARDS = {
    "charuco, A4": "charuco",
    "charuco, letter, 5x5": "charuco --squares 7x9 --square 22 --dictionary DICT_5X5_100 --paper letter",
    "charuco, A3, small": "charuco --squares 20x28 --square 13 --dictionary DICT_4X4_1000 --paper a3",
    "charuco, legacy, even rows": "charuco --squares 7x10 --legacy",
    "charuco, legacy, odd rows": "charuco --squares 8x11 --legacy",
    "charuco, 4 sheets of A4": "charuco --squares 14x18 --square 25 --dictionary DICT_4X4_1000",
    "chessboard, A4": "chessboard --squares 8x11 --square 20",
    "chessboard, A3 landscape": "chessboard --squares 14x9 --square 25 --paper a3",
    "markers, A4": "markers",
    "markers, AprilTags": "markers --dictionary DICT_APRILTAG_36h11 --marker 24",
    "markers, 4 sheets of A4": "markers --size 340x300 --marker 40 --dictionary DICT_6X6_250",
    "chessboard, paper of 300 x 200": "chessboard --squares 7x5 --square 30 --paper 300x200",
}
# As in crates/nelu3d-scan/src/board/print/plan.rs.
LEFT, ABOVE, REST, HEADER, RULER = 13.0, 26.0, 2.0, 124.0, 100.0


def render(pdf, folder):
    subprocess.run(["pdftoppm", "-r", str(DPI), "-gray", str(pdf), str(folder / "page")], check=True,
                   stderr=subprocess.DEVNULL)
    return [cv2.imread(str(p), cv2.IMREAD_GRAYSCALE) for p in sorted(folder.glob("page-*.pgm"))]


def joined(pages, box, margin=10.0, overlap=10.0):
    """Lays sheets over each other as people do, and returns the whole with the place of the board's origin on it, mm."""
    area = [max(box[0] + LEFT + REST, HEADER), max(box[1] + ABOVE + REST, RULER + ABOVE + REST)]
    paper = [pages[0].shape[1] * MM, pages[0].shape[0] * MM]
    printed = [p - 2 * margin for p in paper]
    n = [1 if area[k] <= printed[k] + 0.05 else int(np.ceil((area[k] - overlap) / (printed[k] - overlap)))
         for k in range(2)]
    assert n[0] * n[1] == len(pages), (n, len(pages))
    inset = [0.5 * max(printed[k] - area[k], 0.0) for k in range(2)]
    origin = [margin + inset[0] + LEFT, margin + inset[1] + ABOVE]
    if len(pages) == 1:
        return pages[0], origin
    step = [round((printed[k] - overlap) / MM) for k in range(2)]
    whole = np.full((pages[0].shape[0] + step[1] * (n[1] - 1), pages[0].shape[1] + step[0] * (n[0] - 1)), 255, np.uint8)
    edge = round(margin / MM)
    for i, page in enumerate(pages):
        y, x = step[1] * (i // n[0]), step[0] * (i % n[0])
        # What lies under the next sheet was white or is printed the same.
        inner = page[edge:page.shape[0] - edge, edge:page.shape[1] - edge]
        whole[y + edge:y + edge + inner.shape[0], x + edge:x + edge + inner.shape[1]] = inner
    return whole, origin


def subpixel(image, corners):
    term = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    return cv2.cornerSubPix(image, np.ascontiguousarray(corners, np.float32).reshape(-1, 1, 2), (15, 15), (-1, -1),
                            term).reshape(-1, 2)


def edges_of(image, corner, ends):
    """The corner of a marker where two straight edges meet, from the places where gray falls through the middle."""
    lines = []
    for end in ends:
        d = (end - corner) / np.linalg.norm(end - corner)
        normal = np.array([-d[1], d[0]])
        length = np.linalg.norm(end - corner)
        points = []
        for t in np.linspace(0.15, 0.85, 60) * length:
            at = corner + t * d
            s = np.arange(-12, 12.01, 0.1)
            v = cv2.remap(image, *[(at[k] + s * normal[k]).astype(np.float32).reshape(1, -1) for k in range(2)],
                          cv2.INTER_LINEAR)[0].astype(float)
            crossing = np.nonzero((v[:-1] - 127.5) * (v[1:] - 127.5) <= 0)[0]
            if len(crossing):
                i = crossing[np.argmin(np.abs(s[crossing]))]
                u = (v[i] - 127.5) / (v[i] - v[i + 1]) if v[i] != v[i + 1] else 0.5
                points.append(at + (s[i] + 0.1 * u) * normal)
        vx, vy, x, y = cv2.fitLine(np.float32(points), cv2.DIST_L1, 0, 1e-6, 1e-6).ravel()
        lines.append((np.array([x, y], float), np.array([vx, vy], float)))
    (p, d), (q, e) = lines
    t = np.linalg.solve(np.column_stack([d, -e]), q - p)
    return p + t[0] * d


def found_by_opencv(image, board):
    """Expected places on the board (mm) and those found (px)."""
    kind = board["kind"]
    if kind == "markers":
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board["dictionary"]))
        small = cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
        corners, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(small)
        by_id = dict(zip(ids.ravel().tolist(), corners)) if ids is not None else {}
        expected, found, groups = [], [], []
        for m in board["markers"]:
            if m["id"] not in by_id:
                continue
            rough = by_id[m["id"]].reshape(4, 2).astype(float) * 4 + 1.5
            groups.append(list(range(len(found), len(found) + 4)))
            for i in range(4):
                found.append(edges_of(image, rough[i], [rough[(i + 1) % 4], rough[(i + 3) % 4]]))
                expected.append(m["corners_mm"][i])
        total = 4 * len(board["markers"])
        sides = [(g[i], g[(i + 1) % 4]) for g in groups for i in range(4)]
        return np.array(expected), np.array(found), total, sides
    n, m, s = board["columns"], board["rows"], board["square_mm"]
    total = (n - 1) * (m - 1)
    small = cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    if kind == "charuco":
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board["dictionary"]))
        b = cv2.aruco.CharucoBoard((n, m), s, board["marker_mm"], dictionary)
        b.setLegacyPattern(board.get("legacy", False))
        corners, ids, _, _ = cv2.aruco.CharucoDetector(b).detectBoard(small)
        if ids is None:
            return np.zeros((0, 2)), np.zeros((0, 2)), total, []
        ids = ids.ravel()
        expected = b.getChessboardCorners()[ids][:, :2]
        rough = corners.reshape(-1, 2)
    else:
        ok, corners = cv2.findChessboardCorners(small, (n - 1, m - 1), flags=cv2.CALIB_CB_ADAPTIVE_THRESH)
        if not ok:
            return np.zeros((0, 2)), np.zeros((0, 2)), total, []
        rough = corners.reshape(-1, 2)
        if rough[0].sum() > rough[-1].sum():
            rough = rough[::-1]
        ids = np.arange(total)
        expected = np.array([[(i % (n - 1) + 1) * s, (i // (n - 1) + 1) * s] for i in ids])
    found = subpixel(image, rough * 4 + 1.5)
    at = {tuple(np.round(e / s).astype(int)): i for i, e in enumerate(expected)}
    sides = [(i, at[(k[0] + d[0], k[1] + d[1])]) for k, i in at.items() for d in [(1, 0), (0, 1)]
             if (k[0] + d[0], k[1] + d[1]) in at]
    return expected, found, total, sides


def main(program):
    bad = 0
    print(f"OpenCV {cv2.__version__}; {DPI} dpi: {MM:.4f} mm a pixel")
    print("| board | sheets | corners | largest error of a side, mm | of a place, mm |\n|---|---|---|---|---|")
    for name, arguments in BOARDS.items():
        with tempfile.TemporaryDirectory() as folder:
            folder = Path(folder)
            answer = subprocess.run([program, "board", *arguments.split(), "-o", folder / "b.pdf", "--json"],
                                    check=True, capture_output=True, text=True)
            board = tomllib.loads(json.loads(answer.stdout)["board"])["board"]
            pages = render(folder / "b.pdf", folder)
        if board["kind"] == "markers":
            corners = np.array([m["corners_mm"] for m in board["markers"]]).reshape(-1, 2)
            box = corners.max(0) - corners.min(0)
        else:
            box = [board["columns"] * board["square_mm"], board["rows"] * board["square_mm"]]
        image, origin = joined(pages, box)
        expected, found, total, sides = found_by_opencv(image, board)
        # Pixel centers at integers; the page's edge half a pixel before.
        mm = (found + 0.5) * MM - origin
        side = max((abs(np.linalg.norm(mm[a] - mm[b]) - np.linalg.norm(expected[a] - expected[b])) for a, b in sides),
                   default=np.inf)
        place = np.abs(mm - expected).max() if len(mm) else np.inf
        ok = len(found) == total and side <= LIMIT_MM and place <= LIMIT_MM
        bad += not ok
        print(f"| {name} | {len(pages)} | {len(found)} of {total} | {side:.4f} | {place:.4f} |" + ("" if ok else " **bad**"),
              flush=True)
    sys.exit(bool(bad))


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "target/release/nelu3d")
