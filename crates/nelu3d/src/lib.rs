//! 3D scanning with a camera and any light source that throws a pattern, without a projector model.
//!
//! ```text
//! rig folder ─► calibrate ─► color field ─► reconstruct ─► surface ─► result folder
//! ```
//!
//! The whole path:
//!
//! ```no_run
//! use nelu3d::result::{ExtraFiles, ResultMetadata, Summary, write};
//! use nelu3d::{CalibrationOptions, Progress, ReconstructionOptions, Rig, calibrate, reconstruct};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let rig = Rig::open("my-rig".as_ref())?;
//! let set = rig.pattern_set(None)?; // the first one
//! let progress = Progress::none();
//!
//! // Once per rig and pattern set: the board sweep becomes a color field.
//! let (field, report) = calibrate(&rig, set, &CalibrationOptions::default(), &progress)?;
//! field.save("field.safetensors".as_ref())?;
//! println!("{}", report.frame);
//!
//! // For every scene: the captures become a surface.
//! let scene = rig.scene("cup")?;
//! let cup = reconstruct(&rig, set, &scene, &field, &ReconstructionOptions::default(), &progress)?;
//! println!("{} pixels have a depth", cup.surface.n_valid());
//! let metadata = ResultMetadata { scene: scene.name, set: set.name.clone(), ..Default::default() };
//! let summary = Summary::new(&cup.surface, &cup.diagnostics, &cup.stages, &rig.camera, &metadata);
//! write(&cup.surface, &summary, ExtraFiles::default(), "cup".as_ref())?;
//! # Ok(())
//! # }
//! ```
//!
//! Nothing here prints: work reports to a [`Progress`], which can also cancel it. Conventions (units, frames, pixels)
//! are those of [`nelu3d_scan`]. No part of this crate reads a ground truth or (but for [`from_projector`]) a
//! projector: the crates `nelu3d-evaluate` and `nelu3d-baselines` do.

#[doc(hidden)]
pub mod calibrate;
#[doc(hidden)]
pub mod color_field;
pub mod drift;
pub mod from_projector;
#[doc(hidden)]
pub mod progress;
#[doc(hidden)]
pub mod reconstruct;
pub mod result;
#[doc(hidden)]
pub mod sensor;
pub mod sequence;
#[doc(hidden)]
pub mod surface;
pub mod verdict;

pub use calibrate::{CalibrationError, CalibrationOptions, CalibrationReport, calibrate};
pub use color_field::ColorField;
pub use nelu3d_scan::Rig;
pub use progress::{Progress, Sink};
pub use reconstruct::{Reconstruction, ReconstructionError, ReconstructionOptions, reconstruct};
pub use surface::{PixelStatus, Surface};
