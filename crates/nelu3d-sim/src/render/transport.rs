//! The light that a surface sends to the camera: what falls on it from the light source, and what other surfaces send
//! it, found by path tracing (Kajiya, SIGGRAPH 1986) with the light source looked for at every surface on the way.
//!
//! Light transport is linear: a path weighs the light of every image alike, so that one path serves all images of a
//! shot.

use nalgebra::{Point3, Vector3};

use crate::geometry::{orthonormal_basis, sample_cosine};
use crate::light::{Illumination, LightSource};
use crate::random::mix;
use crate::scene::{Material, SurfaceHit, VirtualScene};
use crate::spec::InterreflectionSpec;

/// Points per ray at which light enters a translucent surface.
const ENTRIES: usize = 4;

/// The generalized golden ratio's powers: multiples of it, mod 1, fill the unit square evenly in any number (Roberts,
/// The Unreasonable Effectiveness of Quasirandom Sequences, 2018).
const R2: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_2];

/// A ray of a pixel: its random numbers come from it.
#[derive(Clone, Copy, Debug)]
pub(super) struct RayId {
    /// A hash of the pixel.
    pub(super) pixel: u64,
    /// Number of the ray in its pixel.
    pub(super) sample: usize,
}

/// A scene in its light, as one thread renders it.
pub(super) struct LightTransport<'a> {
    scene: &'a VirtualScene,
    light: &'a LightSource,
    frames: &'a [Illumination],
    ambient: f32,
    bounces: usize,
    /// Per ray.
    paths: usize,
    /// Memory to use again.
    scratch: Vec<f32>,
    irradiance: Vec<[f32; 3]>,
    radiance: Vec<[f32; 3]>,
}

impl<'a> LightTransport<'a> {
    /// Prepares the rendering of `frames`, with `rays` per pixel.
    pub(super) fn new(
        scene: &'a VirtualScene,
        light: &'a LightSource,
        frames: &'a [Illumination],
        ambient: f32,
        interreflection: InterreflectionSpec,
        rays: usize,
    ) -> Self {
        Self {
            scene,
            light,
            frames,
            ambient,
            bounces: if scene.has_interreflection() { interreflection.bounces } else { 0 },
            paths: interreflection.paths_per_pixel.div_ceil(rays),
            scratch: Vec::new(),
            irradiance: vec![[0.0; 3]; frames.len()],
            radiance: vec![[0.0; 3]; frames.len()],
        }
    }

    /// Returns the light in red, green and blue that leaves a surface in the direction `out` in every frame: albedo
    /// times irradiance, where the surface is diffuse.
    pub(super) fn radiance(&mut self, hit: &SurfaceHit, out: &Vector3<f64>, id: RayId) -> &[[f32; 3]] {
        self.radiance.fill([0.0; 3]);
        if let Material::Translucent { mean_free_path, share } = *self.scene.material(hit) {
            self.add_direct(hit, out, [1.0 - share as f32; 3]);
            let albedo = self.scene.albedo(hit);
            for i in 0..ENTRIES {
                let u = low_discrepancy_point(id.pixel ^ 0x5ca7, id.sample * ENTRIES + i);
                let entry = self.scene.sample_subsurface_entry(hit, mean_free_path, u);
                self.add_diffuse(&entry, albedo.map(|a| a * share as f32 / ENTRIES as f32));
            }
        } else {
            self.add_direct(hit, out, [1.0; 3]);
        }
        if self.bounces > 0 {
            for i in 0..self.paths {
                self.add_path(hit, out, id.pixel, id.sample * self.paths + i);
            }
        }
        &self.radiance
    }

    /// Adds the light of a path from the surface by way of others; `index` numbers it among all paths of a pixel.
    fn add_path(&mut self, hit: &SurfaceHit, out: &Vector3<f64>, pixel: u64, index: usize) {
        let mut random = RandomStream(mix(pixel ^ mix(index as u64)));
        let mut weight = [1.0 / self.paths as f32; 3];
        let (mut hit, mut out) = (*hit, *out);
        // Only the first direction is spread low_discrepancy_point over a pixel's paths: it matters most.
        let mut u = low_discrepancy_point(pixel, index);
        for _ in 0..self.bounces {
            let Some((dir, reflectance)) = self.sample_bounce(&mut hit, &out, u, &mut random) else { return };
            for (w, r) in weight.iter_mut().zip(reflectance) {
                *w *= r;
            }
            if weight.iter().all(|w| *w == 0.0) {
                return;
            }
            let Some(next) = self.scene.hit_from(&hit, dir) else { return };
            (hit, out) = (next, -dir);
            self.add_direct(&hit, &out, weight);
            u = [random.next(), random.next()];
        }
    }

    /// Samples a direction from which light comes that leaves in the direction `out`, and the part of that light that
    /// does; `hit` moves to where it enters.
    fn sample_bounce(
        &self,
        hit: &mut SurfaceHit,
        out: &Vector3<f64>,
        u: [f64; 2],
        random: &mut RandomStream,
    ) -> Option<(Vector3<f64>, [f32; 3])> {
        let albedo = self.scene.albedo(hit);
        match self.scene.material(hit) {
            Material::Lambert => Some((orthonormal_basis(&hit.shading_normal) * sample_cosine(u), albedo)),
            Material::Translucent { mean_free_path, share } => {
                if random.next() < *share {
                    *hit = self.scene.sample_subsurface_entry(hit, *mean_free_path, [random.next(), random.next()]);
                }
                Some((orthonormal_basis(&hit.shading_normal) * sample_cosine(u), albedo))
            }
            Material::Glossy(gloss) => {
                let basis = orthonormal_basis(&hit.shading_normal);
                let out = basis.transpose() * out;
                // As often each part as it reflects of even light.
                let specular = gloss.specular_albedo(out.z);
                let diffuse = (1.0 - specular) * f64::from(albedo.iter().copied().fold(0.0, f32::max));
                let choice = specular / (specular + diffuse).max(1e-12);
                if random.next() < choice {
                    let (dir, part) = gloss.sample_specular(&out, u)?;
                    Some((basis * dir, [(part / choice) as f32; 3]))
                } else {
                    let dir = sample_cosine(u);
                    let part = gloss.diffuse(out.z, dir.z) / (1.0 - choice);
                    Some((basis * dir, albedo.map(|a| a * part as f32)))
                }
            }
        }
    }

    /// Adds what the surface sends in the direction `out` of direct light, times `weight`.
    fn add_direct(&mut self, hit: &SurfaceHit, out: &Vector3<f64>, weight: [f32; 3]) {
        let albedo = self.scene.albedo(hit);
        let Material::Glossy(gloss) = self.scene.material(hit) else {
            return self.add_diffuse(hit, std::array::from_fn(|c| weight[c] * albedo[c]));
        };
        // A light source asks about the points its light comes from, the flash's first: those are the lamps.
        let lamps = std::cell::Cell::new([None::<Point3<f64>>; 2]);
        let lit = self.light.sample(&hit.point, &hit.shading_normal, &|to: &Point3<f64>| {
            let [first, _] = lamps.get();
            lamps.set([first.or(Some(*to)), Some(*to)]);
            self.scene.is_visible_from(hit, to)
        });
        self.light.irradiance(self.frames, &lit, &mut self.scratch, &mut self.irradiance);
        let to_local = orthonormal_basis(&hit.shading_normal).transpose();
        let out = to_local * out;
        // Reflectance of the flash and of the pattern's light. A lamp that gives no light here is not asked about, and
        // does not matter.
        let reflectance = lamps.get().map(|lamp| {
            let Some(lamp) = lamp else { return [0.0; 3] };
            let to = to_local * (lamp - hit.point).normalize();
            let (specular, diffuse) = (gloss.specular(&out, &to), gloss.diffuse(out.z, to.z));
            albedo.map(|a| specular as f32 + a * diffuse as f32)
        });
        let specular = gloss.specular_albedo(out.z) as f32;
        let ambient = albedo.map(|a| (specular + a * (1.0 - specular)) * self.ambient);
        for ((sum, irradiance), shown) in self.radiance.iter_mut().zip(&self.irradiance).zip(self.frames) {
            let reflectance = reflectance[usize::from(*shown != Illumination::White)];
            for c in 0..3 {
                sum[c] += weight[c] * (reflectance[c] * irradiance[c] + ambient[c]);
            }
        }
    }

    /// Adds the direct light that reaches a surface, ambient light too, times `weight`.
    fn add_diffuse(&mut self, hit: &SurfaceHit, weight: [f32; 3]) {
        let lit = self.light.sample(&hit.point, &hit.shading_normal, &|to| self.scene.is_visible_from(hit, to));
        self.light.irradiance(self.frames, &lit, &mut self.scratch, &mut self.irradiance);
        for (sum, irradiance) in self.radiance.iter_mut().zip(&self.irradiance) {
            for c in 0..3 {
                sum[c] += weight[c] * (irradiance[c] + self.ambient);
            }
        }
    }
}

/// Returns the point `index` of a sequence that fills the unit square evenly, shifted by the pixel (Cranley and
/// Patterson, 1976).
fn low_discrepancy_point(pixel: u64, index: usize) -> [f64; 2] {
    let mut shift = RandomStream(pixel);
    R2.map(|step| (shift.next() + index as f64 * step).fract())
}

/// SplitMix64's random numbers in `[0, 1)`.
struct RandomStream(u64);

impl RandomStream {
    fn next(&mut self) -> f64 {
        self.0 = mix(self.0);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}
