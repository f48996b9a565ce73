//! A color field on disk: one safetensors file that describes itself.
//!
//! Metadata key `nelu3d` holds JSON: format, frame, form, shape of the validity volume and [`FieldMetadata`]. Tensors:
//! `coeffs` (f16, grid) or `params` (f32, hash and frequency); `t_range` (f32, tiles × 2, mm along the ray); `lit` (u8,
//! cells); `positions` (u8, columns of cells), where boards were counted. The last key of the JSON, `sha256`, is a
//! checksum over all of it; files of earlier versions have none.
//!
//! [`FieldMetadata`]: super::FieldMetadata

#[doc(hidden)]
pub mod checksum;
mod error;
#[doc(hidden)]
pub mod header;
mod load;
mod save;

pub use error::CheckpointError;
