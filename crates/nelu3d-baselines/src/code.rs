//! The code, learned from the images that were projected.

use std::path::{Path, PathBuf};

use nelu3d_scan::pattern::{Axis, Stripes};
use nelu3d_scan::rig::PatternSet;
use nelu3d_scan::{Image, Projector, Rig};

use super::error::DecodeError;
use super::response::Response;

/// How much an image may vary across its axis, as a share of full scale: a code of eight bits and a half.
pub(crate) const FLAT: f32 = 1.5 / 255.0;

/// How much light a projected value makes.
#[derive(Clone, Debug, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ProjectedLight {
    /// The value to this power.
    Power(f32),
    /// As it was measured.
    Response(Response),
}

impl ProjectedLight {
    /// Returns the light, 0 to 1, of a value 0 to 1.
    pub fn of(&self, value: f32) -> f32 {
        match self {
            ProjectedLight::Power(gamma) => value.max(0.0).powf(*gamma),
            ProjectedLight::Response(response) => response.light_of(value),
        }
    }
}

/// The light of one projected image, or of one of its color channels, along its axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// Place in the pattern set.
    pub image: usize,
    /// Color channel of the projected image; 0 in gray images.
    pub channel: usize,
    /// The file.
    pub path: PathBuf,
    /// Light, 0 to 1, one per column (or row).
    pub values: Vec<f32>,
}

/// The lines of all images that change along one axis.
#[derive(Clone, Debug)]
pub struct AxisCode {
    /// The axis.
    pub axis: Axis,
    /// In the set's order, all of one length.
    pub lines: Vec<Line>,
}

impl AxisCode {
    /// Columns (or rows) of the projected image.
    pub(crate) fn len(&self) -> usize {
        self.lines[0].values.len()
    }
}

/// A pattern set as it was projected.
#[derive(Clone, Debug)]
pub(crate) struct Code {
    /// One or both axes; x first.
    pub(super) axes: Vec<AxisCode>,
    /// Whether an image differs between its color channels.
    pub(super) colored: bool,
}

impl Code {
    /// Reads the projected images of a set from `patterns/`.
    ///
    /// # Errors
    ///
    /// One is missing, cannot be read, has another size than the projector, or changes along both axes.
    pub(crate) fn read(
        rig: &Rig,
        set: &PatternSet,
        projector: &Projector,
        light: &ProjectedLight,
    ) -> Result<Self, DecodeError> {
        let size = [projector.optics.width, projector.optics.height];
        Self::read_sized(rig, set, Some(size), light)
    }

    /// Reads the projected images where the projector's size is not known yet: all images must have one.
    pub(crate) fn read_sized(
        rig: &Rig,
        set: &PatternSet,
        size: Option<[usize; 2]>,
        light: &ProjectedLight,
    ) -> Result<Self, DecodeError> {
        let mut all = Vec::new();
        let images = read_projected(rig, set, size)?;
        let size = images.first().map(|(_, image)| [image.width, image.height]);
        for (i, (path, image)) in images.into_iter().enumerate() {
            all.push(lines(image, &path, i, light)?);
        }
        let colored = all.iter().any(|(_, lines)| lines.len() > 1);
        // An image that shows the same everywhere goes with its neighbors in the set.
        let axis_of = |i: usize| {
            let known = |j: &usize| all[*j].0;
            (0..=i).rev().find_map(|j| known(&j)).or_else(|| (i..all.len()).find_map(|j| known(&j)))
        };
        let axes: Vec<AxisCode> = [Axis::X, Axis::Y]
            .into_iter()
            .map(|axis| {
                let n = if axis == Axis::X { size.unwrap_or_default()[0] } else { size.unwrap_or_default()[1] };
                let mine = (0..all.len()).filter(|i| axis_of(*i) == Some(axis));
                let mut lines: Vec<Line> = mine.flat_map(|i| all[i].1.clone()).collect();
                lines.iter_mut().for_each(|l| l.values.resize(n, l.values[0]));
                AxisCode { axis, lines }
            })
            .filter(|code| !code.lines.is_empty())
            .collect();
        if axes.is_empty() {
            return Err(DecodeError::file(
                rig.root.join("patterns"),
                format!("the images of set `{}` show the same everywhere", set.name),
                "use the images as they were projected",
            ));
        }
        Ok(Self { axes, colored })
    }
}

/// Reads the projected images of a set, as they are in `patterns/`, in the set's order. All must be of one size: `size`
/// (width, height), if it is known.
///
/// # Errors
///
/// One is missing, cannot be read, or has another size.
pub(crate) fn read_projected(
    rig: &Rig,
    set: &PatternSet,
    mut size: Option<[usize; 2]>,
) -> Result<Vec<(PathBuf, Image)>, DecodeError> {
    let read = |name: &String| {
        let path = rig.projected(name);
        if !path.exists() {
            return Err(DecodeError::file(
                path,
                "is missing, and a decoder learns the code from the projected images",
                "put the images that were projected into patterns/, named as the captures are",
            ));
        }
        let image = nelu3d_scan::image::read_any(&path).map_err(nelu3d_scan::rig::RigError::from)?;
        let [w, h] = *size.get_or_insert([image.width, image.height]);
        if [image.width, image.height] != [w, h] {
            return Err(DecodeError::file(
                path,
                format!("is {} × {} px, but the projector's image is {w} × {h}", image.width, image.height),
                "use the images as they were projected, and the projector.json made for them",
            ));
        }
        Ok((path, image))
    };
    set.images.iter().map(read).collect()
}

/// Returns the axis along which an image changes (none if it does not change at all) and its light along it, one line
/// per color channel, or one if the channels are the same. `path` is the image's file and `index` its place in the
/// pattern set.
///
/// # Errors
///
/// It changes along both axes; the message names the file.
pub fn lines(
    image: Image,
    path: &Path,
    index: usize,
    light: &ProjectedLight,
) -> Result<(Option<Axis>, Vec<Line>), DecodeError> {
    let (w, h, c) = (image.width, image.height, image.channels);
    let gray = image.data.chunks_exact(c).all(|p| p.iter().all(|v| *v == p[0]));
    let channels = if gray { 1 } else { c };
    let axis = match Stripes::of(&image, FLAT) {
        Stripes::Along(axis) => Some(axis),
        Stripes::Constant => None,
        Stripes::Both => {
            return Err(DecodeError::file(
                path,
                "changes along x and along y, and a decoder needs images that change along one of them",
                "use `nelu3d calibrate` and `nelu3d reconstruct`, or `decode --method turbosl`, for patterns of any kind",
            ));
        }
    };
    let line = |channel: usize| {
        let value = |i: usize| match axis {
            Some(Axis::Y) => image.data[i * w * c + channel],
            _ => image.data[i * c + channel],
        };
        let n = if axis == Some(Axis::Y) { h } else { w };
        let values = (0..n).map(|i| light.of(value(i))).collect();
        Line { image: index, channel, path: path.to_path_buf(), values }
    };
    Ok((axis, (0..channels).map(line).collect()))
}

/// Returns a line's value at `u` px, between its columns: linear, and constant beyond the ends.
///
/// # Panics
///
/// If the line is empty.
pub fn value_at(values: &[f32], u: f32) -> f32 {
    let last = values.len() - 1;
    let u = u.clamp(0.0, last as f32);
    let i = (u as usize).min(last.saturating_sub(1));
    let f = u - i as f32;
    values[i] + f * (values[(i + 1).min(last)] - values[i])
}
