//! What a scan *is*: cameras, images, rig folders, boards, poses, patterns and meshes. Nothing here learns anything.
//!
//! Conventions, everywhere in this workspace:
//!
//! - Lengths are millimeters, angles radians.
//! - The camera's frame is the world: x right, y down, z forward. *Depth* is camera-frame z.
//! - Pixel centers lie at integer coordinates (OpenCV): the center of the top-left pixel is (0, 0).
//! - A transform reads as a fraction: `cam_from_board` takes board coordinates to camera coordinates.
//! - Images are linear `f32` in `[0, 1]`: (code − black level) / (saturation − black level); a value ≥ 1 is clipped.

pub mod board;
pub mod camera;
pub mod cloud;
pub mod image;
pub mod import;
pub mod input;
pub mod intrinsics;
pub mod least_squares;
pub mod mesh;
pub mod npy;
pub mod output;
pub mod path_text;
pub mod pattern;
pub mod pose;
pub mod radiometry;
pub mod rig;
pub mod statistics;

pub use camera::{Camera, Projector, Ray};
pub use image::Image;
pub use mesh::Mesh;
pub use rig::Rig;
