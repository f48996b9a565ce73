//! All tests of this crate that are not examples in its documents: one file per file of `src`, and what reads foreign
//! bytes. They are not inside of the library, which would be compiled a second time for them, in minutes.

mod board;
mod camera;
mod cloud;
mod foreign_bytes;
mod image;
mod import;
mod input;
mod intrinsics;
mod least_squares;
mod mesh;
mod npy;
mod output;
mod path_text;
mod pattern;
mod pose;
mod radiometry;
mod rig;
mod statistics;
