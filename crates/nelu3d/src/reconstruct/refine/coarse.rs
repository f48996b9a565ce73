//! The refinement in a reduced image, from which that of the full one begins near its end: light fractions, the light
//! that surfaces throw on each other, and depth find each other in many steps, which are cheap there.

use std::borrow::Cow;

use nelu3d_scan::statistics::median;
use nelu3d_scan::{Camera, Image};
use rayon::prelude::*;

use super::settings::RefineSettings;
use crate::color_field::CameraRays;
use crate::reconstruct::initialize::InitialDepth;
use crate::reconstruct::maps::interpolate_within;
use crate::reconstruct::scene::Scene;
use crate::sensor::Measurements;
use crate::surface::PixelStatus;

/// Pixels of the surface from which most steps are in a reduced image. With fewer, pixels at outlines, where a reduced
/// one sees two surfaces, are too many: of 42,000, mean errors grow by a tenth.
const MIN_PIXELS: usize = 1_000_000;
/// Pixels that the reduced image may have.
const MANY_PIXELS: usize = 150_000;
/// Largest reduction.
const MAX_FACTOR: usize = 4;
/// Steps of depth from the initial surface within which that of the reduced image counts: at outlines, its pixels see
/// two surfaces.
const NEAR: f32 = 3.0;

/// Returns the factor by which the image is reduced; `None` where all steps are in the full one.
pub(super) fn factor(initial: &InitialDepth, settings: &RefineSettings) -> Option<usize> {
    let n = initial.inv_z.iter().filter(|v| v.is_finite()).count();
    let is_enough = |f: &usize| n / (f * f) <= MANY_PIXELS || *f == MAX_FACTOR;
    (settings.fine_steps > 0 && n >= MIN_PIXELS).then(|| (2..=MAX_FACTOR).find(is_enough).expect("the last is enough"))
}

/// What a reduced image has of its own.
pub(super) struct Reduced {
    factor: usize,
    camera: Camera,
    white: Image,
    measurements: Measurements,
    initial: InitialDepth,
}

impl Reduced {
    /// Reduces a scene and its initial surface.
    pub(super) fn new(scene: &Scene<'_>, initial: &InitialDepth, factor: usize) -> Self {
        let mut measurements = scene.measurements.reduced(factor);
        let (w, width) = (measurements.width, scene.camera.width);
        // Means of two surfaces would be none: the middle one of the block's pixels.
        let middle = |i: usize| {
            let [x, y] = [i % w * factor, i / w * factor];
            let pixels = (y..y + factor).flat_map(|row| (x..x + factor).map(move |column| row * width + column));
            median(&mut pixels.map(|i| initial.inv_z[i]).filter(|v| v.is_finite()).collect::<Vec<_>>())
                .unwrap_or(f32::NAN)
        };
        let inv_z: Vec<f32> = (0..measurements.n()).into_par_iter().with_min_len(w).map(middle).collect();
        for (status, inv_z) in measurements.status.iter_mut().zip(&inv_z) {
            if *status == PixelStatus::Valid && inv_z.is_nan() {
                *status = PixelStatus::Ambiguous;
            }
        }
        let initial = InitialDepth { inv_z, step: initial.step };
        Self { factor, camera: scene.camera.binned(factor), white: scene.white.binned(factor), measurements, initial }
    }

    /// Returns the reduced scene and its initial surface.
    pub(super) fn scene<'a>(&'a self, of: &'a Scene<'_>) -> (Scene<'a>, &'a InitialDepth) {
        let lit = |i: usize| self.measurements.status[i] == PixelStatus::Valid;
        let scene = Scene {
            camera: &self.camera,
            part: of.part,
            field: of.field,
            white: Cow::Borrowed(&self.white),
            grid: Cow::Borrowed(&*of.grid),
            rays: CameraRays::of_lit(of.camera, of.field, self.factor, of.part.origin, lit),
            measurements: self.measurements.clone(),
        };
        (scene, &self.initial)
    }

    /// Returns a map of the reduced image as one of the full image, of the pixels that `initial` has: camera z, mm, or
    /// any that is smooth up to jumps beyond `max_difference`.
    pub(super) fn expanded(&self, map: &[f32], initial: &InitialDepth, width: usize, max_difference: f32) -> Vec<f32> {
        let (f, half) = (self.factor as f32, 0.5 * (self.factor as f32 - 1.0));
        let [w, h] = [self.measurements.width, self.measurements.height];
        let place = |at: usize, n: usize| ((at as f32 - half) / f).clamp(0.0, n as f32 - 1.0);
        let of = |i: usize| {
            if initial.inv_z[i].is_nan() {
                return f32::NAN;
            }
            interpolate_within(map, w, h, place(i % width, w), place(i / width, h), max_difference)
        };
        (0..initial.inv_z.len()).into_par_iter().with_min_len(width).map(of).collect()
    }

    /// Returns where the refinement of the full image begins: at the inverse depths found in the reduced one, 1/mm, and
    /// where these are far from the initial surface, there.
    pub(super) fn start(&self, found: &[f32], initial: &InitialDepth, width: usize) -> InitialDepth {
        let step = initial.step;
        let mut inv_z = self.expanded(found, initial, width, NEAR * step);
        for (v, initial) in inv_z.iter_mut().zip(&initial.inv_z) {
            let is_near = (*v - initial).abs() <= NEAR * step;
            if !is_near {
                *v = *initial;
            }
        }
        InitialDepth { inv_z, step }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f32 = 1e-5;

    /// A slanted plane in the left half of 40 × 30 px, a nearer one in the right half; three columns have no surface.
    fn planes() -> InitialDepth {
        let inv_z = (0..1200).map(|i| match i % 40 {
            0..=2 => f32::NAN,
            x if x < 20 => 1e-3 + 0.3 * STEP * x as f32,
            _ => 1.4e-3,
        });
        InitialDepth { inv_z: inv_z.collect(), step: STEP }
    }

    fn reduced(inv_z: impl Fn(usize, usize) -> f32) -> (Reduced, Vec<f32>) {
        let map: Vec<f32> = (0..300).map(|i| inv_z(i % 20, i / 20)).collect();
        let initial = InitialDepth { inv_z: map.clone(), step: STEP };
        let camera = Camera::pinhole(20, 15, 100.0, 100.0, 10.0, 7.0);
        let measurements = Measurements::for_test(20, 15, 3);
        (Reduced { factor: 2, camera, white: Image::new(20, 15, 1), measurements, initial }, map)
    }

    #[test]
    fn only_large_surfaces_are_refined_in_a_reduced_image() {
        let large = InitialDepth { inv_z: vec![1e-3; 4_000_000], step: STEP };
        let settings = RefineSettings::default();
        assert_eq!(factor(&large, &settings), Some(4));
        assert_eq!(factor(&large, &RefineSettings { fine_steps: 0, ..settings }), None);
        assert_eq!(factor(&planes(), &settings), None);
    }

    #[test]
    fn the_full_image_begins_at_what_was_found_near_by() {
        let initial = planes();
        // Half a step farther on the slanted plane; the column of blocks at the outline is between both.
        let (reduced, found) = reduced(|x, _| match x {
            9 => 1.2e-3,
            x if x < 9 => 1e-3 + 0.3 * STEP * (2.0 * x as f32 + 0.5) - 0.5 * STEP,
            _ => 1.4e-3,
        });
        let start = reduced.start(&found, &initial, 40);
        for (i, (v, before)) in start.inv_z.iter().zip(&initial.inv_z).enumerate() {
            match i % 40 {
                0..=2 => assert!(v.is_nan(), "{i}: no surface becomes none"),
                // Between the middles of blocks that lie on the plane.
                4..=16 => assert!((before - v - 0.5 * STEP).abs() < 0.01 * STEP, "{i}: {v} from {before}"),
                18 | 19 => assert_eq!(v, before, "what lies between two surfaces is on neither"),
                _ => assert!((v - before).abs() <= NEAR * STEP, "{i}: {v} from {before}"),
            }
        }
    }
}
