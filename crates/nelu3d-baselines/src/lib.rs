//! The methods that NeLU3D is compared with. They know the projector, and find in every pixel which of its columns lit
//! it (all but LookUp3D, which looks its codeword up in a table of the sweep).
//!
//! ```text
//! patterns/ ─► code ─┐
//! captures ──────────┴► decode (one file a method) ─► columns, rows ─► triangulate ─► surface
//! ```
//!
//! The code is learned from the *projected images*: no file says what family they are of, and none needs to. Every
//! image must change along x or along y only. The projected values are taken to be linear in light;
//! [`DecodeOptions::gamma`] says otherwise, and so does the response that [`projector::calibrate_projector`] measures.
//! A calibrated projector is required.
//!
//! To add a method: a file with a function that fills a `DecodedCoordinates`, a variant of [`Method`], an arm in
//! `decode::columns`.

mod captured;
pub mod code;
mod coordinates;
mod decode;
mod diagnostics;
mod error;
pub mod gray;
pub mod lookup3d;
mod method;
mod mps;
mod options;
mod per_pixel;
mod phase;
pub mod projector;
mod response;
mod triangulate;
pub mod turbosl;
pub mod wave;
pub mod zncc;

pub use decode::decode;
pub use diagnostics::{DecodeDiagnostics, Decoding};
pub use error::DecodeError;
pub use method::Method;
pub use options::{Columns, DecodeOptions};
