//! Structured light without a projector model: calibration, color field, reconstruction, evaluation.
//!
//! ```text
//! rig folder ─► calibrate ─► color field ─► reconstruct ─► surface ─► result folder
//!                                                             └► evaluate (against a truth)
//! ```
//!
//! The whole path:
//!
//! ```no_run
//! use nelu3d::result::{About, MeshFiles};
//! use nelu3d::{Progress, calibrate, reconstruct, result};
//! use nelu3d_scan::Rig;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let rig = Rig::open("my-rig".as_ref())?;
//! let set = rig.pattern_set(None)?; // the first one
//! let progress = Progress::none();
//!
//! // Once per rig and pattern set: the board sweep becomes a color field.
//! let (field, report) = calibrate::run(&rig, set, &Default::default(), &progress)?;
//! field.save("field.safetensors".as_ref())?;
//! println!("{}", report.frame);
//!
//! // For every scene: the captures become a surface.
//! let scene = rig.scene("cup")?;
//! let surface = reconstruct::run(&rig, set, &scene, &field, &Default::default(), &progress)?;
//! println!("{} pixels have a depth", surface.n_kept());
//! let about = About { scene: scene.name, set: set.name.clone(), ..About::default() };
//! result::write(&surface, &rig.camera, &about, MeshFiles::default(), "cup".as_ref())?;
//! # Ok(())
//! # }
//! ```
//!
//! - [`calibrate`] finds the boards, their poses and the light, and fits the field; or computes it from a calibrated
//!   projector.
//! - [`color_field`] is c(x), the intensities that the patterns have at every point of the calibrated volume: its
//!   coordinates, how it is stored, where it holds.
//! - [`reconstruct`] decodes a cost volume over the field and refines the surface by volume rendering in a narrow band.
//! - [`decode`] has the methods that all of this is compared with; all but LookUp3D need a calibrated projector.
//! - [`sequence`] reconstructs scenes that move, each frame from the one before.
//! - [`evaluate`] judges depth, normals and 1σ by region. No reconstruction sees a truth.
//! - [`mod@result`] is the folder that all of it is written to.
//!
//! Nothing here prints: work reports to a [`Progress`], which can also cancel it. Conventions (units, frames, pixels) are
//! those of [`nelu3d_scan`].

pub mod calibrate;
pub mod color_field;
pub mod decode;
pub mod evaluate;
pub mod progress;
pub mod reconstruct;
pub mod result;
pub mod sdf;
pub mod sequence;

pub use progress::Progress;
pub use result::{Left, Reconstruction};
