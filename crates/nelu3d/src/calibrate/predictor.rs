//! What a fitted field predicts at the samples of a position.

use std::borrow::Cow;

use nalgebra::{Point3, Vector3};

use crate::color_field::Form;
use crate::color_field::frame::PointOnRay;
use crate::color_field::grid::Grid;
use crate::color_field::published::PublishedForm;

/// A field as it is measured: the spline that every stage reads, or form `published` itself.
pub(super) enum Predictor<'a> {
    /// A spline.
    Spline(Cow<'a, Grid>),
    /// The published form.
    Published(&'a PublishedForm),
}

/// Predictions at the samples of a position.
pub(super) enum Predictions<'a> {
    /// A spline, evaluated sample by sample.
    Spline(&'a Grid),
    /// Values of all samples, and slopes along the ray, 1/mm, of every `stride`th.
    Known { values: Vec<f32>, slopes: Vec<f32>, stride: usize },
}

impl<'a> Predictor<'a> {
    /// Prepares a form.
    pub(super) fn of(form: &'a Form) -> Self {
        match form {
            Form::Grid(g) => Self::Spline(Cow::Borrowed(g)),
            Form::Hash(h) => Self::Spline(Cow::Owned(h.to_grid())),
            Form::Frequency(f) => Self::Spline(Cow::Owned(f.to_grid())),
            Form::Published(p) => Self::Published(p),
        }
    }

    /// Returns the spline, if it is one.
    pub(super) fn spline(&self) -> Option<&Grid> {
        match self {
            Self::Spline(grid) => Some(grid),
            Self::Published(_) => None,
        }
    }

    /// Predicts `k` values at the samples that `for_each` goes through: points, mm, and the directions of their rays.
    pub(super) fn predict(
        &self,
        k: usize,
        stride: usize,
        for_each: impl FnOnce(&mut dyn FnMut(Point3<f64>, Vector3<f64>)),
    ) -> Predictions<'_> {
        let form = match self {
            Self::Spline(grid) => return Predictions::Spline(grid),
            Self::Published(form) => form,
        };
        let (mut points, mut dirs) = (Vec::new(), Vec::new());
        for_each(&mut |x, dir| {
            points.push(x);
            dirs.push(dir);
        });
        let mut values = vec![0.0; points.len() * k];
        form.query(&points, &mut values);
        // The last of every stride, as samples are counted from 1.
        let some = |all: usize| (stride - 1..all).step_by(stride);
        let few: Vec<_> = some(points.len()).map(|i| points[i]).collect();
        let along: Vec<_> = some(points.len()).map(|i| dirs[i]).collect();
        let (mut same, mut slopes) = (vec![0.0; few.len() * k], vec![0.0; few.len() * k]);
        form.query_along(&few, &along, &mut same, &mut slopes);
        Predictions::Known { values, slopes, stride }
    }
}

impl Predictions<'_> {
    /// Writes the values at the `n`th sample (from 0), which lies at `at`, and their slopes along the ray where they
    /// are asked for, at every `stride`th sample.
    pub(super) fn eval(&self, n: usize, at: PointOnRay, with_slope: bool, c: &mut [f32], d: &mut [f32]) {
        let k = c.len();
        match self {
            Self::Spline(grid) if with_slope => grid.eval_along(at.q, at.dq, c, d),
            Self::Spline(grid) => grid.eval(at.q, c),
            Self::Known { values, slopes, stride } => {
                c.copy_from_slice(&values[n * k..][..k]);
                if with_slope {
                    d.copy_from_slice(&slopes[n / stride * k..][..k]);
                }
            }
        }
    }
}
