//! A hand that holds a board: a thumb over the board's face, and its ball at the edge.

use nalgebra::{Isometry3, Translation3};
use nelu3d_scan::Mesh;

use super::albedo::Albedo;
use super::material::Material;
use super::object::SceneObject;
use super::shape::Shape;
use crate::spec::ShapeSpec;

/// Radius of the thumb, as a part of the hand's size.
const THUMB: f64 = 0.18;

/// Radius of the ball of the thumb, as a part of the hand's size.
const BALL: f64 = 0.4;

/// A hand at the edge of a board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hand {
    /// The hand's origin lies on the board's outline, its y axis points along the thumb.
    pub board_from_hand: Isometry3<f64>,
    /// Reach of the thumb from the origin, mm.
    pub size_mm: f64,
    /// Albedo of the skin.
    pub albedo: [f64; 3],
}

impl Hand {
    /// Returns the hand's parts as objects: the thumb lies on the board's face (z = 0), on the camera's side of it.
    pub(super) fn objects(&self, cam_from_board: &Isometry3<f64>) -> [SceneObject; 3] {
        let (thumb, ball) = (THUMB * self.size_mm, BALL * self.size_mm);
        let bone = self.size_mm - thumb;
        let part = |shape: ShapeSpec, along: f64| {
            let shape = Shape::new(&shape, &Mesh::default());
            let cam_from_part = cam_from_board * self.board_from_hand * Translation3::new(0.0, along, -thumb);
            let skin = Albedo::Constant(self.albedo.map(|v| v as f32));
            SceneObject::new(shape, cam_from_part, skin, Material::Lambert)
        };
        [
            part(ShapeSpec::Sphere { radius_mm: ball }, 0.0),
            part(ShapeSpec::Cylinder { radius_mm: thumb, height_mm: bone }, 0.5 * bone),
            part(ShapeSpec::Sphere { radius_mm: thumb }, bone),
        ]
    }
}
