//! The color field as a whole: coordinates, form, validity and metadata.

use std::borrow::Cow;

use super::frame::FieldFrame;
use super::frequency::FrequencyForm;
use super::grid::Grid;
use super::hash::HashForm;
use super::metadata::FieldMetadata;
use super::published::PublishedForm;
use super::validity::Validity;

/// The form in which c is stored.
#[derive(Clone, Debug)]
pub enum Form {
    /// Cubic B-spline, fitted by least squares.
    Grid(Grid),
    /// Multiresolution hash encoding and a small network.
    Hash(Box<HashForm>),
    /// Frequency encoding and a network.
    Frequency(Box<FrequencyForm>),
    /// The paper's own: a hash encoding in the camera's frame and a network.
    Published(Box<PublishedForm>),
}

impl Form {
    /// Returns the number of pattern channels k.
    pub fn k(&self) -> usize {
        match self {
            Form::Grid(g) => g.k,
            Form::Hash(h) => h.k(),
            Form::Frequency(f) => f.k(),
            Form::Published(p) => p.k(),
        }
    }
}

/// A calibrated color field: everything that a reconstruction needs to know of the light source.
#[derive(Clone, Debug)]
pub struct ColorField {
    /// Coordinates in which c is stored.
    pub frame: FieldFrame,
    /// Values of c.
    pub form: Form,
    /// Volume in which the field was supervised.
    pub validity: Validity,
    /// Metadata: what the field was made from, and how good it is.
    pub metadata: FieldMetadata,
}

impl ColorField {
    /// Returns the number of pattern channels k.
    pub fn k(&self) -> usize {
        self.form.k()
    }

    /// Returns the field as a spline, which every later stage evaluates, but for recipe `paper` where the form is
    /// `published`.
    pub fn to_grid(&self) -> Cow<'_, Grid> {
        match &self.form {
            Form::Grid(g) => Cow::Borrowed(g),
            Form::Hash(h) => Cow::Owned(h.to_grid()),
            Form::Frequency(f) => Cow::Owned(f.to_grid()),
            Form::Published(p) => Cow::Owned(p.to_grid()),
        }
    }

    /// Returns the standard deviation of depth that errors of the boards' poses and shapes leave, or of a projector's
    /// calibration, mm, at a point with unit coordinates `q` that the camera sees through `plane`, its (x/z, y/z); 0
    /// where it is not known.
    ///
    /// Where every position was held out in turn, it is how far these were from the field where as many boards have lit
    /// the same rays: an upper bound, since a held-out board has an error of its own. Else it follows from a mean:
    /// Errors of n boards average out where all of them were. Codewords that m of them have shown are n/m times as
    /// uncertain as a variance; carried ones, and those that nobody counted, rest on one.
    pub fn pose_sigma_mm(&self, plane: [f32; 2], q: [f32; 3]) -> f32 {
        let along = |covariance: &[[f64; 3]; 3]| {
            let at = [1.0, f64::from(plane[0]), f64::from(plane[1])];
            (0..3).map(|i| (0..3).map(|j| at[i] * covariance[i][j] * at[j]).sum::<f64>()).sum::<f64>().max(0.0)
        };
        let Some(quality) = &self.metadata.quality else {
            let of_projector = self.metadata.residual.as_ref().and_then(|r| r.pose_covariance.as_ref());
            return of_projector.map_or(0.0, |covariance| along(covariance).sqrt() as f32);
        };
        if let Some(by_support) = quality.depth_by_support {
            let n = usize::from(self.validity.positions_at(q).unwrap_or(0));
            return by_support[n.min(by_support.len() - 1)] as f32;
        }
        let variance = quality.pose_covariance.as_ref().map_or(quality.pose_mm * quality.pose_mm, along);
        let n = self.metadata.boards.len().max(1) as f64;
        let fewer = if self.validity.positions.is_empty() {
            1.0
        } else {
            n / f64::from(self.validity.positions_at(q).unwrap_or(1))
        };
        (variance * fewer.max(1.0)).sqrt() as f32
    }

    /// Returns the name of the form.
    pub fn form_name(&self) -> &'static str {
        match &self.form {
            Form::Grid(_) => "grid",
            Form::Hash(_) => "hash",
            Form::Frequency(_) => "frequency",
            Form::Published(_) => "published",
        }
    }
}
