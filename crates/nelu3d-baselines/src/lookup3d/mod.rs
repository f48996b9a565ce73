//! LookUp3D: depth from a lookup table of the sweep itself, with no model of the light at all.
//!
//! For every camera pixel the sweep gives, at each of its P board positions, a codeword of k normalized intensities and
//! the depth of the board's plane. To decode is to find the position whose codeword is closest to the measured one,
//! pixel by pixel; what remains of the difference says how much to believe it.
//!
//! ```text
//! sweep ─► build ─► FullTable ─► compress ─► LowRank          file: .npy and .npz of the LookUp3D tools
//!                        └──────────┬──────────┘
//!     scene ─► Measurements ─► decode (search ─► interpolate ─► accept or reject) ─► LookupMaps
//! ```
//!
//! Searches ([`Search`]): over all positions; coarse to fine; around an earlier result. They share the kernel
//! [`nelu3d_field::nearest`], the interpolation between positions and the criterion of what is rejected.
//!
//! A sample is missing (NaN) where the board's outline or its light did not reach, or where an image is clipped; a
//! codeword that lacks one channel is missing as a whole. A missing sample is never chosen. The depth of a board's
//! plane is kept for every pixel, as the LookUp3D tools do.

mod build;
mod compress;
mod decode;
mod diagnostics;
mod error;
pub mod file;
mod full;
pub mod interpolate;
mod low_rank;
mod options;
mod scene;
mod search;
mod shape;
mod table;

pub use build::{BuiltTable, build};
pub use compress::{Compressed, Rank, compress};
pub use decode::{LookupMaps, MapBuffers, decode, decode_near};
pub use diagnostics::{LookupDiagnostics, TableSummary};
pub use error::LookupTableError;
pub use full::FullTable;
pub use low_rank::LowRank;
pub use options::{Interpolation, LookupOptions, Search, SearchSettings};
pub(crate) use scene::decode_scene;
pub use shape::TableShape;
pub use table::Table;
