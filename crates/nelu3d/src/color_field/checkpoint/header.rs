//! The description that a checkpoint holds of itself.

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use crate::color_field::frame::FieldFrame;
use crate::color_field::frequency::FrequencyShape;
use crate::color_field::hash::HashShape;
use crate::color_field::metadata::FieldMetadata;
use crate::color_field::published::{PublishedSettings, PublishedShape};
use crate::color_field::validity::ValidityShape;

/// Version of the layout.
pub const FORMAT: u32 = 2;
/// Oldest format whose hash tables are laid out as today's: by bricks.
pub(super) const FIRST_WITH_BRICKS: u32 = 2;

/// The JSON description in a checkpoint.
#[derive(Serialize, Deserialize)]
pub(super) struct Header {
    pub(super) format: u32,
    pub(super) units: String,
    pub(super) frame: FieldFrame,
    pub(super) form: FormHeader,
    pub(super) validity: ValidityShape,
    #[serde(rename = "about")]
    pub(super) metadata: FieldMetadata,
}

/// The form of the field, and all of it but its values.
#[derive(Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub(super) enum FormHeader {
    Grid { cells: [usize; 3], k: usize },
    Hash(Box<HashShape>),
    Frequency(Box<FrequencyShape>),
    Published(Box<PublishedShape>),
}

/// Largest number of values per node of a grid or point of a field: far beyond any pattern set.
const MAX_K: usize = 4096;

/// Largest number of nodes of the grid that a field is turned into, times k.
const MAX_NODES: usize = 1 << 28;

/// Largest deviation of a frame's axes from unit length and right angles: they are written with all their digits.
const MAX_SKEW: f64 = 1e-6;

impl Header {
    /// Checks for values that a damaged or foreign file may have and no field has; the error names what is wrong.
    pub(super) fn check(&self) -> Result<(), String> {
        let expect = |good: bool, what: &str| if good { Ok(()) } else { Err(what.to_owned()) };
        let (cells, k) = match &self.form {
            FormHeader::Grid { cells, k } => (*cells, *k),
            FormHeader::Hash(shape) => {
                let finest = shape.config.encoding.finest_resolution;
                expect(shape.settings.finest() == finest, "its network is not of the size it states")?;
                (shape.settings.cells, shape.k)
            }
            FormHeader::Frequency(shape) => (shape.settings.cells, shape.k),
            FormHeader::Published(shape) => {
                let PublishedSettings { cells, frame, cube, options } = &shape.settings;
                expect(options.check(shape.k).is_ok(), "its network is impossible")?;
                expect(options.config(shape.k) == shape.config, "its network is not of the size it states")?;
                expect(*frame == self.frame && cube.is_valid(), "its network lies in another volume")?;
                (*cells, shape.k)
            }
        };
        let metadata = &self.metadata;
        expect((1..=MAX_K).contains(&k), "its number of channels is impossible")?;
        expect(metadata.images.len().checked_mul(metadata.channels) == Some(k), "its images do not make its channels")?;
        let nodes = cells.iter().try_fold(k, |n, c| n.checked_mul(c.checked_add(3)?));
        let good = cells.iter().all(|c| *c > 0) && nodes.is_some_and(|n| n <= MAX_NODES);
        expect(good, "its number of cells is impossible")?;

        let f = &self.frame;
        let mut numbers = f.origin.iter().chain(f.axes.as_flattened()).chain(&f.lo).chain(&f.hi).chain([&f.kappa]);
        expect(numbers.all(|v| v.is_finite()), "its frame is not finite")?;
        expect((0..3).all(|i| f.lo[i] < f.hi[i]), "its volume is empty")?;
        let axes = Matrix3::from_fn(|r, c| f.axes[r][c]);
        let is_rotation = (axes * axes.transpose() - Matrix3::identity()).amax() < MAX_SKEW && axes.determinant() > 0.0;
        expect(is_rotation, "its axes are no rotation")?;

        expect(
            metadata.camera.len() >= 6 && metadata.camera.iter().all(|v| v.is_finite()),
            "its camera is incomplete",
        )?;
        let [width, height] = [metadata.camera[0], metadata.camera[1]];
        let v = &self.validity;
        let sizes = [width, height].into_iter().zip(v.tiles);
        let good = v.tile_px > 0
            && v.cells.iter().all(|c| *c > 0)
            && sizes.into_iter().all(|(px, tiles)| px >= 1.0 && tiles == (px as usize).div_ceil(v.tile_px));
        expect(good, "its calibrated volume does not belong to its camera")?;
        let motions = metadata.corrected.iter().flat_map(|m| [m.rotation, m.translation_mm, m.about_mm]);
        let places = metadata.boards.iter().map(|b| b.translation_mm);
        let good = motions.chain(places).flatten().all(f64::is_finite)
            && metadata.boards.iter().all(|b| b.rotation.iter().map(|v| v * v).sum::<f64>() > 0.5);
        expect(good, "its boards' places are impossible")?;
        let noise = metadata.noise;
        let good = noise.read.is_finite() && noise.gain.is_finite() && noise.read >= 0.0 && noise.gain >= 0.0;
        expect(good, "its noise is impossible")
    }
}
