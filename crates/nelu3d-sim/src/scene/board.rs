//! The board of a sweep: printed, perhaps bent or with a curled corner, held by hands.

use nalgebra::{Isometry3, Translation3};
use nelu3d_scan::board::{Artwork, Board, BoardError};

use super::albedo::Albedo;
use super::hand::Hand;
use super::material::Material;
use super::object::SceneObject;
use super::shape::{Rectangle, Shape};
use crate::spec::{AxisSpec, BoardBendSpec, BoardCurlSpec, DeformationSpec, Spec};

/// A printed board, to be placed in a scene.
#[derive(Clone, Debug)]
pub struct PrintedBoard {
    /// In a frame whose origin is the board's, or of a bent board its middle.
    shape: Shape,
    board_from_shape: Translation3<f64>,
    albedo: Albedo,
}

impl PrintedBoard {
    /// Returns the board of a spec.
    ///
    /// # Errors
    ///
    /// It cannot be printed as described.
    pub fn of_spec(spec: &Spec) -> Result<Self, BoardError> {
        let board = spec.board.board();
        Ok(Self::new(spec, &board, Artwork::new(&board)?))
    }

    /// Returns the board as the spec prints, bends, and curls it.
    fn new(spec: &Spec, board: &Board, artwork: Artwork) -> Self {
        let [x0, y0, x1, y1] = board.extent_mm;
        let [ink, paper] = spec.board_albedo.map(|v| v as f32);
        let dot_mm = spec.print_dpi.map_or(0.0, |dpi| 25.4 / dpi);
        let flat = |origin| Albedo::Board { artwork: Box::new(artwork), ink, paper, dot_mm, origin };
        if spec.board_bend.is_none() && spec.board_curl.is_none() {
            let shape = Shape::Rectangle(Rectangle::new([x0, y0], [x1, y1]));
            return Self { shape, board_from_shape: Translation3::identity(), albedo: flat([0.0; 2]) };
        }
        let (middle, half) = ([0.5 * (x0 + x1), 0.5 * (y0 + y1)], [0.5 * (x1 - x0), 0.5 * (y1 - y0)]);
        let mut shape = Shape::Rectangle(Rectangle::new(half.map(|h| -h), half));
        if let Some(bend) = &spec.board_bend {
            shape = shape.deformed(&of_bend(bend, half));
        }
        if let Some(curl) = &spec.board_curl {
            shape = shape.deformed(&of_curl(curl, half));
        }
        let board_from_shape = Translation3::new(middle[0], middle[1], 0.0);
        Self { shape, board_from_shape, albedo: flat(middle) }
    }

    /// Returns the board at a pose, and after it the hands that hold it.
    pub(super) fn objects(&self, cam_from_board: &Isometry3<f64>, hands: &[Hand]) -> Vec<SceneObject> {
        let cam_from_shape = cam_from_board * self.board_from_shape;
        let mut objects =
            vec![SceneObject::new(self.shape.clone(), cam_from_shape, self.albedo.clone(), Material::Lambert)];
        objects.extend(hands.iter().flat_map(|h| h.objects(cam_from_board)));
        objects
    }
}

/// Returns the bend of a board of half sides `half_mm` about its middle.
fn of_bend(bend: &BoardBendSpec, half_mm: [f64; 2]) -> DeformationSpec {
    let length = 2.0 * if bend.axis == AxisSpec::X { half_mm[1] } else { half_mm[0] };
    DeformationSpec::Bend { curvature_per_mm: curvature(length, bend.sagitta_mm), axis: bend.axis }
}

/// Returns the curl of a corner of a board of half sides `half_mm` about its middle.
fn of_curl(curl: &BoardCurlSpec, [x, y]: [f64; 2]) -> DeformationSpec {
    let corner = x.hypot(y);
    let (height_mm, from_mm) = (curl.height_mm, corner - curl.length_mm);
    DeformationSpec::Curl { height_mm, from_mm, to_mm: corner, direction: [x, y, 0.0] }
}

/// Returns the curvature of an arc of a length whose height over its chord is `sagitta`, 1/mm. The height over the
/// length is (1 − cos a) / 2a, where a is half the arc's angle; it grows up to a = 2.33.
fn curvature(length: f64, sagitta: f64) -> f64 {
    let (mut low, mut high) = (0.0, 2.3);
    for _ in 0..60 {
        let a: f64 = 0.5 * (low + high);
        // 1 − cos a = 2 sin²(a/2) keeps its digits at small angles.
        let height = length * (0.5 * a).sin().powi(2) / a;
        if height < sagitta.abs() {
            low = a;
        } else {
            high = a;
        }
    }
    (low + high) / length * sagitta.signum()
}
