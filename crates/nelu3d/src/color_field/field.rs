//! The color field as a whole: its coordinates, form, validity and metadata.

use std::borrow::Cow;

use super::frame::FieldFrame;
use super::frequency::FrequencyForm;
use super::grid::Grid;
use super::hash::HashForm;
use super::metadata::FieldMetadata;
use super::validity::Validity;

/// How c is stored.
#[derive(Clone, Debug)]
pub enum Form {
    /// Cubic B-spline.
    Grid(Grid),
    /// Hash encoding and MLP.
    Hash(Box<HashForm>),
    /// Frequency encoding and MLP.
    Frequency(Box<FrequencyForm>),
}

/// A calibrated color field: everything that a reconstruction needs to know of the light source.
#[derive(Clone, Debug)]
pub struct ColorField {
    /// Its coordinates.
    pub frame: FieldFrame,
    /// Its values.
    pub form: Form,
    /// Where it holds.
    pub validity: Validity,
    /// What it was made from.
    pub metadata: FieldMetadata,
}

impl ColorField {
    /// Number of pattern channels k.
    pub fn k(&self) -> usize {
        match &self.form {
            Form::Grid(g) => g.k,
            Form::Hash(h) => h.k(),
            Form::Frequency(f) => f.k(),
        }
    }

    /// The field as a spline, which every later stage evaluates.
    pub fn to_grid(&self) -> Cow<'_, Grid> {
        match &self.form {
            Form::Grid(g) => Cow::Borrowed(g),
            Form::Hash(h) => Cow::Owned(h.to_grid()),
            Form::Frequency(f) => Cow::Owned(f.to_grid()),
        }
    }

    /// Name of the form.
    pub fn form_name(&self) -> &'static str {
        match &self.form {
            Form::Grid(_) => "grid",
            Form::Hash(_) => "hash",
            Form::Frequency(_) => "frequency",
        }
    }
}
