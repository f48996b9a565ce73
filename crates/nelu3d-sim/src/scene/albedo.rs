//! Albedo of surfaces.

use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use nelu3d_scan::Image;
use nelu3d_scan::board::Artwork;
use nelu3d_scan::image::{ImageFileError, read_any};

use crate::random::mix;
use crate::spec::AlbedoSpec;

/// The reflectance of a surface by its point; see [`AlbedoSpec`].
#[derive(Clone, Debug)]
pub enum Albedo {
    /// One reflectance of red, green, and blue, 0 to 1, for the whole surface.
    Constant([f32; 3]),
    /// Smooth waves along all three axes.
    Waves {
        /// Red, green and blue where the waves are lowest.
        from: [f32; 3],
        /// Red, green and blue where they are highest.
        to: [f32; 3],
        /// Radians per mm.
        per_mm: f64,
    },
    /// Cubes of two colors by turns.
    Checker {
        /// Red, green and blue of the cube that begins at the origin.
        from: [f32; 3],
        /// Red, green and blue of its neighbors.
        to: [f32; 3],
        /// Side of a cube, mm.
        size: f64,
    },
    /// Rings of uneven width about an axis.
    Wood {
        /// Red, green and blue of early wood.
        from: [f32; 3],
        /// Red, green and blue of late wood.
        to: [f32; 3],
        /// Mean distance of the rings, mm.
        ring: f64,
        /// The axis: 0, 1 or 2 for x, y or z.
        axis: usize,
        /// Seed of the unevenness.
        seed: u64,
    },
    /// A picture, projected along an axis.
    Image {
        /// Albedos, three channels.
        image: Arc<Image>,
        /// Width and height on the object, mm; its middle is at the origin.
        size: [f64; 2],
        /// The axes of the object's frame along its width and its height.
        axes: [usize; 2],
    },
    /// The print of a board.
    Board {
        /// What is printed.
        artwork: Box<Artwork>,
        /// Albedo of the ink.
        ink: f32,
        /// Albedo of the paper.
        paper: f32,
        /// Side of a printer's dot, mm; 0 for exact edges.
        dot_mm: f64,
        /// The object's origin on the board, mm.
        origin: [f64; 2],
    },
    /// Colors of the mesh's vertices, which the scene interpolates: they need the point of the mesh.
    Vertices(Arc<Vec<Vector3<f64>>>),
}

impl Albedo {
    /// Returns the albedo of a spec. `colors` are those of the mesh's vertices, for [`AlbedoSpec::VertexColors`].
    ///
    /// # Errors
    ///
    /// The picture of a spec that names one cannot be read.
    pub fn new(spec: &AlbedoSpec, colors: &[[u8; 3]]) -> Result<Self, ImageFileError> {
        let f32s = |rgb: &[f64; 3]| rgb.map(|v| v as f32);
        Ok(match spec {
            AlbedoSpec::Constant { rgb } => Self::Constant(f32s(rgb)),
            AlbedoSpec::Waves { from, to, period_mm } => {
                Self::Waves { from: f32s(from), to: f32s(to), per_mm: TAU / period_mm }
            }
            AlbedoSpec::Checker { from, to, size_mm } => {
                Self::Checker { from: f32s(from), to: f32s(to), size: *size_mm }
            }
            AlbedoSpec::Wood { from, to, ring_mm, axis, seed } => {
                Self::Wood { from: f32s(from), to: f32s(to), ring: *ring_mm, axis: axis.index(), seed: *seed }
            }
            AlbedoSpec::Image { file, size_mm, axis, srgb } => {
                let axes = [[2, 1], [0, 2], [0, 1]][axis.index()];
                Self::Image { image: Arc::new(read_image(file, *srgb)?), size: *size_mm, axes }
            }
            AlbedoSpec::VertexColors { srgb } => {
                let value = |c: &u8| if *srgb { linear(f32::from(*c) / 255.0) } else { f32::from(*c) / 255.0 };
                let color = |rgb: &[u8; 3]| Vector3::from_iterator(rgb.iter().map(|c| f64::from(value(c))));
                Self::Vertices(Arc::new(colors.iter().map(color).collect()))
            }
        })
    }

    /// Returns red, green and blue at a point of the object's frame, mm.
    ///
    /// # Panics
    ///
    /// If it is [`Self::Vertices`]: those take the point of the mesh
    /// ([`VirtualScene::albedo`](super::VirtualScene::albedo)).
    pub fn at(&self, p: &Point3<f64>) -> [f32; 3] {
        match self {
            Self::Constant(rgb) => *rgb,
            Self::Waves { from, to, per_mm } => {
                let waves = (p.x * per_mm).sin() + (p.y * per_mm + 1.0).sin() + (p.z * per_mm + 2.0).sin();
                between(from, to, (0.5 + waves / 6.0) as f32)
            }
            Self::Checker { from, to, size } => {
                let odd = p.iter().map(|v| (v / size).floor()).sum::<f64>().rem_euclid(2.0) >= 1.0;
                if odd { *to } else { *from }
            }
            Self::Wood { from, to, ring, axis, seed } => {
                let across = p[(axis + 1) % 3].hypot(p[(axis + 2) % 3]);
                // Unevenness is long along the axis, as a trunk's is.
                let mut q = p.coords / (4.0 * ring);
                q[*axis] *= 0.2;
                let phase = (across / ring + 1.5 * noise(&q, *seed)).rem_euclid(1.0);
                // Wood darkens slowly through a year and ends with a sharp, but smooth, edge.
                let late = phase * phase * (1.0 - smoothstep((phase - 0.88) / 0.12));
                between(from, to, late as f32)
            }
            Self::Image { image, size, axes } => {
                let [w, h] = [image.width, image.height];
                let at = |i: usize, n: usize| (p[axes[i]] / size[i] + 0.5) * n as f64 - 0.5;
                sample(image, [at(0, w), at(1, h)])
            }
            Self::Board { artwork, ink, paper, dot_mm, origin } => {
                // A dot is ink or paper as the artwork is at its center.
                let [x, y] = [p.x + origin[0], p.y + origin[1]]
                    .map(|v| if *dot_mm > 0.0 { ((v / dot_mm).floor() + 0.5) * dot_mm } else { v });
                [ink + (paper - ink) * artwork.albedo(x, y); 3]
            }
            Self::Vertices(_) => unreachable!("a mesh looks them up"),
        }
    }
}

fn between(from: &[f32; 3], to: &[f32; 3], part: f32) -> [f32; 3] {
    std::array::from_fn(|c| from[c] + part * (to[c] - from[c]))
}

/// Reads a picture as albedos, three channels.
fn read_image(file: &Path, srgb: bool) -> Result<Image, ImageFileError> {
    let image = read_any(file)?;
    let value = |v: &f32| if srgb { linear(*v) } else { *v }.clamp(0.0, 1.0);
    let data: Vec<f32> = match image.channels {
        3 => image.data.iter().map(value).collect(),
        _ => image.data.iter().flat_map(|v| [value(v); 3]).collect(),
    };
    Ok(Image { channels: 3, data, ..image })
}

/// Returns the linear light of an sRGB value (IEC 61966-2-1).
fn linear(c: f32) -> f32 {
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

/// Interpolates bilinearly; beyond its border a picture goes on as it ends.
fn sample(image: &Image, at: [f64; 2]) -> [f32; 3] {
    let sides = [image.width, image.height];
    let at: [f64; 2] = std::array::from_fn(|i| at[i].clamp(0.0, (sides[i] - 1) as f64));
    let low = at.map(|v| v as usize);
    let part: [f32; 2] = std::array::from_fn(|i| (at[i] - low[i] as f64) as f32);
    let pixel = |dx: usize, dy: usize| {
        let (x, y) = ((low[0] + dx).min(sides[0] - 1), (low[1] + dy).min(sides[1] - 1));
        let i = 3 * (y * sides[0] + x);
        [image.data[i], image.data[i + 1], image.data[i + 2]]
    };
    let [top, bottom] = [0, 1].map(|dy| between(&pixel(0, dy), &pixel(1, dy), part[0]));
    between(&top, &bottom, part[1])
}

fn smoothstep(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// Returns smooth noise in `[−1, 1]` with features of size 1: random values at whole coordinates, between them smooth.
fn noise(p: &Vector3<f64>, seed: u64) -> f64 {
    let cell = p.map(f64::floor);
    let part = (p - cell).map(smoothstep);
    let mut sum = 0.0;
    for corner in 0..8 {
        let offset = [corner & 1, corner >> 1 & 1, corner >> 2];
        let (mut h, mut weight) = (seed, 1.0);
        for i in 0..3 {
            h = mix(h ^ (cell[i] as i64 + offset[i]) as u64);
            weight *= if offset[i] == 1 { part[i] } else { 1.0 - part[i] };
        }
        sum += weight * (2.0 * (h >> 11) as f64 / (1u64 << 53) as f64 - 1.0);
    }
    sum
}
