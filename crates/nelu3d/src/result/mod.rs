//! Result folders: writing and reading. JSON of results is made here and nowhere else.

#[doc(hidden)]
pub mod extra;
pub mod picture;
mod read;
mod summary;
mod write;

pub use extra::ExtraFiles;
pub use read::{ReadError, SavedResult, read_frame_state};
pub use summary::{
    CameraJson, DepthRange, FORMAT, Input, Machine, MeshSize, PixelCounts, ResultMetadata, Summary, peak_memory_bytes,
};
pub use write::{WriteError, write, write_into};
