//! rig.toml: parsing, validation and writing.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

use super::{Channels, KnownPose, PROJECTOR_FILE, PatternSet, RIG_FILE, Rig, RigError};
use crate::board::{Artwork, Board, BoardError, BoardKind, Dictionary, Marker};
use crate::camera::{Camera, Projector, read_camera, read_projector, write_camera, write_projector};
use crate::output::{create_dir, write_atomic};

/// The newest version of the layout that is understood.
const FORMAT: i64 = 1;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RigToml {
    format: i64,
    #[serde(default)]
    name: String,
    pub(super) camera: CameraToml,
    #[serde(default)]
    images: ImagesToml,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pattern_sets: Vec<PatternSetToml>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) board: Option<BoardToml>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) poses: Vec<PoseToml>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraToml {
    #[serde(default = "default_intrinsics")]
    pub(super) intrinsics: String,
    pub(super) channels: String,
    black_level: f64,
    saturation: f64,
}

fn default_intrinsics() -> String {
    "camera.json".into()
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct ImagesToml {
    white: String,
    black: String,
}

impl Default for ImagesToml {
    fn default() -> Self {
        Self { white: "white.png".into(), black: "black.png".into() }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PatternSetToml {
    name: String,
    images: Vec<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    inverse: Vec<String>,
}

/// All kinds of board in one: which keys a kind has is checked by hand, which gives better messages than an enum.
#[derive(Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BoardToml {
    kind: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    columns: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rows: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    square_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    marker_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    dictionary: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    legacy: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    extent_mm: Option<[f64; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    markers: Option<Vec<Marker>>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PoseToml {
    position: String,
    rotation: [f64; 3],
    translation: [f64; 3],
}

impl Rig {
    /// Opens a rig: reads rig.toml, the intrinsics and, where there is one, the projector. No image is read.
    ///
    /// `path` is the folder or its rig.toml.
    ///
    /// # Errors
    ///
    /// No rig is there; rig.toml has an unknown key, a newer format or an impossible value; the camera or projector file
    /// is bad. The message names the file, the key and a remedy.
    pub fn open(path: &Path) -> Result<Self, RigError> {
        let (root, toml) = read_toml(path)?;
        let camera = read_camera(&root.join(&toml.camera.intrinsics))?;
        let file = root.join(PROJECTOR_FILE);
        let projector = if file.exists() { Some(read_projector(&file)?) } else { None };
        let (rig, problems) = from_toml(&root, toml, camera, projector);
        match problems.into_iter().next() {
            Some(first) => Err(first),
            None => Ok(rig),
        }
    }

    /// Writes rig.toml, the intrinsics and, where there is one, the projector into [`Rig::root`], which is created.
    ///
    /// # Errors
    ///
    /// A file cannot be written, or the rig holds a value that could not be read back.
    pub fn save(&self) -> Result<(), RigError> {
        let path = self.root.join(RIG_FILE);
        let text = toml::to_string(&to_toml(self))
            .map_err(|e| RigError::Syntax { path: path.clone(), reason: e.to_string() })?;
        // What cannot be opened again must not be written either.
        let (_, problems) = from_toml(&self.root, to_toml(self), self.camera.clone(), self.projector.clone());
        if let Some(first) = problems.into_iter().next() {
            return Err(first);
        }
        create_dir(&self.root)?;
        write_atomic(&path, |w| w.write_all(text.as_bytes()))?;
        write_camera(&self.root.join(&self.camera_file), &self.camera)?;
        if let Some(projector) = &self.projector {
            write_projector(&self.root.join(PROJECTOR_FILE), projector)?;
        }
        Ok(())
    }
}

/// Parses the rig.toml at `path` (or in it) without judging its values; also returns the rig's folder.
pub(super) fn read_toml(path: &Path) -> Result<(PathBuf, RigToml), RigError> {
    let root = match path.file_name() {
        Some(name) if name == RIG_FILE && !path.is_dir() => match path.parent() {
            Some(p) if !p.as_os_str().is_empty() => p.to_path_buf(),
            _ => PathBuf::from("."),
        },
        _ => path.to_path_buf(),
    };
    let file = root.join(RIG_FILE);
    if !file.is_file() {
        return Err(RigError::NotARig { path: path.to_path_buf() });
    }
    let bytes = std::fs::read(&file).map_err(|source| RigError::Io { path: file.clone(), source })?;
    let text = String::from_utf8(bytes)
        .map_err(|e| RigError::Syntax { path: file.clone(), reason: format!("it is no text ({})", e.utf8_error()) })?;
    let syntax = |e: toml::de::Error| RigError::Syntax { path: file.clone(), reason: toml_reason(&e, &text) };
    // The version comes first: a newer layout may well have keys that are unknown here.
    let table: toml::Table = toml::from_str(&text).map_err(syntax)?;
    if let Some(found) = table.get("format").and_then(toml::Value::as_integer).filter(|&f| f > FORMAT) {
        return Err(RigError::NewerFormat { path: file, found, known: FORMAT });
    }
    Ok((root, toml::from_str(&text).map_err(syntax)?))
}

/// What the TOML parser says, in one line: its own message draws the place over several.
fn toml_reason(e: &toml::de::Error, text: &str) -> String {
    let message = e.message().trim().replace('\n', ", ");
    match e.span().and_then(|span| text.get(..span.start)) {
        Some(before) => format!("line {}: {message}", before.matches('\n').count() + 1),
        None => message,
    }
}

/// The rig that rig.toml describes, and everything that is wrong with its values. With problems the rig is only good for
/// looking for more of them.
pub(super) fn from_toml(
    root: &Path,
    toml: RigToml,
    camera: Camera,
    projector: Option<Projector>,
) -> (Rig, Vec<RigError>) {
    let mut judge = Judge { path: root.join(RIG_FILE), problems: Vec::new() };
    judge.expect(toml.format == FORMAT, "format", format!("is {}", toml.format), "it must be 1");

    let channels = Channels::from_name(&toml.camera.channels);
    judge.expect(
        channels.is_some(),
        "camera.channels",
        format!("is \"{}\"", toml.camera.channels),
        &format!("it must be one of: {}", Channels::ALL.map(Channels::name).join(", ")),
    );
    let (black, saturation) = (toml.camera.black_level, toml.camera.saturation);
    judge.expect(
        black.is_finite() && saturation.is_finite() && saturation > black,
        "camera.saturation",
        format!("is {saturation}, with camera.black_level = {black}"),
        "saturation must lie above black_level",
    );
    judge.file_name("camera.intrinsics", &toml.camera.intrinsics);
    judge.file_name("images.white", &toml.images.white);
    judge.file_name("images.black", &toml.images.black);

    let mut names = HashSet::new();
    for set in &toml.pattern_sets {
        let key = |field: &str| format!("pattern_sets `{}`: {field}", set.name);
        judge.file_name("pattern_sets.name", &set.name);
        let unique = names.insert(set.name.clone());
        judge.expect(unique, &key("name"), "is used twice", "give every pattern set its own name");
        judge.expect(!set.images.is_empty(), &key("images"), "is empty", "list at least one pattern image");
        for name in set.images.iter().chain(&set.inverse) {
            judge.file_name(&key("images"), name);
        }
        judge.expect(
            set.inverse.is_empty() || set.inverse.len() == set.images.len(),
            &key("inverse"),
            format!("lists {} files for {} images", set.inverse.len(), set.images.len()),
            "list one inverse per image, in the same order, or none",
        );
    }

    let board = toml.board.and_then(|b| board(b, &mut judge));

    let mut positions = HashSet::new();
    for pose in &toml.poses {
        let key = format!("poses `{}`", pose.position);
        judge.expect(positions.insert(&pose.position), &key, "is given twice", "give one pose per position");
        let finite = pose.rotation.iter().chain(&pose.translation).all(|v| v.is_finite());
        judge.expect(finite, &key, "holds a value that is not finite", "give finite numbers, or leave the pose out");
    }
    let poses = toml
        .poses
        .into_iter()
        .map(|p| KnownPose {
            cam_from_board: Isometry3::new(Vector3::from(p.translation), Vector3::from(p.rotation)),
            position: p.position,
        })
        .collect();
    let rig = Rig {
        root: root.to_path_buf(),
        name: toml.name,
        camera,
        camera_file: toml.camera.intrinsics,
        channels: channels.unwrap_or(Channels::Mono),
        black_level: black,
        saturation,
        white: toml.images.white,
        black: toml.images.black,
        pattern_sets: toml
            .pattern_sets
            .into_iter()
            .map(|s| PatternSet { name: s.name, images: s.images, inverse: s.inverse })
            .collect(),
        board,
        poses,
        projector,
    };
    (rig, judge.problems)
}

/// Collects what is wrong with rig.toml.
struct Judge {
    path: PathBuf,
    problems: Vec<RigError>,
}

impl Judge {
    /// Complains unless `good`; returns it.
    fn expect(&mut self, good: bool, key: &str, problem: impl Into<String>, remedy: &str) -> bool {
        if !good {
            self.problems.push(RigError::Invalid {
                path: self.path.clone(),
                key: key.into(),
                problem: problem.into(),
                remedy: remedy.into(),
            });
        }
        good
    }

    fn file_name(&mut self, key: &str, name: &str) {
        self.expect(!name.trim().is_empty(), key, "is empty", "give a name");
    }
}

/// The board, if its keys make one.
fn board(b: BoardToml, judge: &mut Judge) -> Option<Board> {
    let before = judge.problems.len();
    // Every kind has its own keys; one that belongs to another kind is a mistake.
    let allowed: &[&str] = match b.kind.as_str() {
        "charuco" => &["columns", "rows", "square_mm", "marker_mm", "dictionary", "legacy"],
        "chessboard" => &["columns", "rows", "square_mm"],
        "markers" => &["dictionary", "markers"],
        other => {
            let problem = format!("is \"{other}\"");
            judge.expect(false, "board.kind", problem, "it must be one of: charuco, chessboard, markers");
            return None;
        }
    };
    for (key, given) in [
        ("columns", b.columns.is_some()),
        ("rows", b.rows.is_some()),
        ("square_mm", b.square_mm.is_some()),
        ("marker_mm", b.marker_mm.is_some()),
        ("dictionary", b.dictionary.is_some()),
        ("legacy", b.legacy.is_some()),
        ("markers", b.markers.is_some()),
    ] {
        let key_path = format!("board.{key}");
        if allowed.contains(&key) {
            judge.expect(given || key == "legacy", &key_path, "is missing", &format!("a {} board needs it", b.kind));
        } else {
            judge.expect(!given, &key_path, "does not belong here", &format!("a {} board has no such key", b.kind));
        }
    }
    if judge.problems.len() > before {
        return None;
    }

    let (columns, rows) = (b.columns.unwrap_or_default(), b.rows.unwrap_or_default());
    let (square_mm, marker_mm) = (b.square_mm.unwrap_or_default(), b.marker_mm.unwrap_or_default());
    let dictionary = b.dictionary.unwrap_or_default();
    if allowed.contains(&"dictionary") {
        let known = Dictionary::by_name(&dictionary).is_ok();
        let remedy = format!("it must be one of: {}", Dictionary::names().join(", "));
        judge.expect(known, "board.dictionary", format!("is \"{dictionary}\""), &remedy);
    }
    if allowed.contains(&"columns") {
        // A chessboard's corners lie between squares, and a plane needs more than one row of them.
        for (key, n) in [("board.columns", columns), ("board.rows", rows)] {
            judge.expect((3..=1000).contains(&n), key, format!("is {n}"), "count the squares: there are 3 or more");
        }
        let good = square_mm.is_finite() && square_mm > 0.0;
        judge.expect(good, "board.square_mm", format!("is {square_mm}"), "give the side of a square in millimeters");
    }
    let kind = match b.kind.as_str() {
        "charuco" => {
            let good = marker_mm > 0.0 && marker_mm < square_mm;
            let problem = format!("is {marker_mm}, with board.square_mm = {square_mm}");
            judge.expect(
                good,
                "board.marker_mm",
                problem,
                "a marker is smaller than its square and larger than nothing",
            );
            let legacy = b.legacy.unwrap_or(false);
            BoardKind::Charuco { columns, rows, square_mm, marker_mm, dictionary, legacy }
        }
        "chessboard" => BoardKind::Chessboard { columns, rows, square_mm },
        _ => {
            let markers = b.markers.unwrap_or_default();
            judge_markers(&markers, judge);
            BoardKind::Markers { dictionary, markers }
        }
    };
    if judge.problems.len() > before {
        return None;
    }
    let extent_mm = b.extent_mm.unwrap_or_else(|| bounding_box_mm(&kind));
    let [x0, y0, x1, y1] = extent_mm;
    let good = extent_mm.iter().all(|v| v.is_finite()) && x0 < x1 && y0 < y1;
    let problem = format!("is {extent_mm:?}");
    if !judge.expect(good, "board.extent_mm", problem, "it must be [x_min, y_min, x_max, y_max]") {
        return None;
    }
    let board = Board { kind, extent_mm };
    match Artwork::new(&board) {
        Ok(_) => Some(board),
        Err(e) => {
            let problem = match e {
                BoardError::Invalid { reason } => format!("cannot be printed as described: {reason}"),
                other => other.to_string(),
            };
            judge.expect(false, "board", problem, "measure the board again, and correct its numbers").then_some(board)
        }
    }
}

fn judge_markers(markers: &[Marker], judge: &mut Judge) {
    judge.expect(!markers.is_empty(), "board.markers", "is empty", "list the markers of the board");
    let mut ids = HashSet::new();
    for m in markers {
        let key = format!("board.markers, id {}", m.id);
        judge.expect(ids.insert(m.id), &key, "is listed twice", "every marker of a board has its own id");
        let c = &m.corners_mm;
        // Twice the area, by the shoelace formula.
        let area: f64 = (0..4).map(|i| c[i][0] * c[(i + 1) % 4][1] - c[(i + 1) % 4][0] * c[i][1]).sum();
        // NaN fails this comparison too.
        let good = area.abs() > 1e-6;
        judge.expect(good, &key, "has corners_mm without an area", "give the corners in order, in millimeters");
    }
}

/// The outline of a board that states none: of its squares, or of its markers.
fn bounding_box_mm(kind: &BoardKind) -> [f64; 4] {
    match kind {
        BoardKind::Charuco { columns, rows, square_mm, .. } | BoardKind::Chessboard { columns, rows, square_mm } => {
            [0.0, 0.0, *columns as f64 * square_mm, *rows as f64 * square_mm]
        }
        BoardKind::Markers { markers, .. } => {
            let empty = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
            markers
                .iter()
                .flat_map(|m| m.corners_mm)
                .fold(empty, |b, [x, y]| [b[0].min(x), b[1].min(y), b[2].max(x), b[3].max(y)])
        }
    }
}

fn to_toml(rig: &Rig) -> RigToml {
    RigToml {
        format: FORMAT,
        name: rig.name.clone(),
        camera: CameraToml {
            intrinsics: rig.camera_file.clone(),
            channels: rig.channels.name(),
            black_level: rig.black_level,
            saturation: rig.saturation,
        },
        images: ImagesToml { white: rig.white.clone(), black: rig.black.clone() },
        pattern_sets: rig
            .pattern_sets
            .iter()
            .map(|s| PatternSetToml { name: s.name.clone(), images: s.images.clone(), inverse: s.inverse.clone() })
            .collect(),
        board: rig.board.as_ref().map(board_to_toml),
        poses: rig
            .poses
            .iter()
            .map(|p| PoseToml {
                position: p.position.clone(),
                rotation: p.cam_from_board.rotation.scaled_axis().into(),
                translation: p.cam_from_board.translation.vector.into(),
            })
            .collect(),
    }
}

fn board_to_toml(board: &Board) -> BoardToml {
    let extent_mm = (board.extent_mm != bounding_box_mm(&board.kind)).then_some(board.extent_mm);
    match board.kind.clone() {
        BoardKind::Charuco { columns, rows, square_mm, marker_mm, dictionary, legacy } => BoardToml {
            kind: "charuco".into(),
            columns: Some(columns),
            rows: Some(rows),
            square_mm: Some(square_mm),
            marker_mm: Some(marker_mm),
            dictionary: Some(dictionary),
            legacy: Some(legacy),
            extent_mm,
            markers: None,
        },
        BoardKind::Chessboard { columns, rows, square_mm } => BoardToml {
            kind: "chessboard".into(),
            columns: Some(columns),
            rows: Some(rows),
            square_mm: Some(square_mm),
            extent_mm,
            ..BoardToml::default()
        },
        BoardKind::Markers { dictionary, markers } => BoardToml {
            kind: "markers".into(),
            dictionary: Some(dictionary),
            extent_mm,
            markers: Some(markers),
            ..BoardToml::default()
        },
    }
}
