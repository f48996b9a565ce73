//! Poses in files.

use std::path::Path;

use nalgebra::{Isometry3, Matrix4, Rotation3, Translation3, UnitQuaternion};

use nelu3d_scan::input::read_text;

use super::CadError;

/// Reads `cam_from_cad`: the key of that name in a JSON file (such as an earlier `alignment.json`), or sixteen numbers,
/// row by row, separated by spaces, commas or line breaks. Lengths are mm, after any scale.
///
/// # Errors
///
/// The file cannot be read, or holds no rigid motion.
pub fn read_pose(path: &Path) -> Result<Isometry3<f64>, CadError> {
    let bad = |problem: String| CadError::Pose { path: path.to_owned(), problem };
    let text = read_text(path).map_err(|e| bad(format!("cannot be read: {e}")))?;
    let rows: Vec<f64> = if text.trim_start().starts_with('{') {
        #[derive(serde::Deserialize)]
        struct File {
            cam_from_cad: [[f64; 4]; 4],
        }
        let file: File = serde_json::from_str(&text).map_err(|e| bad(e.to_string()))?;
        file.cam_from_cad.concat()
    } else {
        let words = text.split(|c: char| c.is_whitespace() || ",;[]".contains(c)).filter(|w| !w.is_empty());
        let numbers = words.map(|w| w.parse::<f64>().map_err(|_| bad(format!("`{w}` is not a number"))));
        numbers.collect::<Result<_, _>>()?
    };
    if rows.len() != 16 {
        return Err(bad(format!("has {} numbers instead of 16", rows.len())));
    }
    let m = Matrix4::from_row_slice(&rows);
    let r = m.fixed_view::<3, 3>(0, 0).into_owned();
    let rigid = (r.transpose() * r - nalgebra::Matrix3::identity()).amax() < 1e-3 && r.determinant() > 0.0;
    // NaN must fail here too.
    if !rigid || !rows.iter().all(|v| v.is_finite()) || m.row(3) != nalgebra::RowVector4::new(0.0, 0.0, 0.0, 1.0) {
        return Err(bad("is no rotation and translation".to_owned()));
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&r));
    Ok(Isometry3::from_parts(Translation3::new(m[(0, 3)], m[(1, 3)], m[(2, 3)]), rotation))
}

/// Returns a pose as the rows of a 4 × 4 matrix.
pub fn pose_rows(pose: &Isometry3<f64>) -> [[f64; 4]; 4] {
    let m = pose.to_homogeneous();
    std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]))
}
