use std::io::{Cursor, Read as _};

use nelu3d_scan::Mesh;

/// Name of the model in the archive.
const MODEL: &str = "3D/3dmodel.model";

/// Reads back what [`Mesh::write`] wrote; other programs' archives may hold more than one object, which this is not
/// for.
pub(super) fn read_own(bytes: &[u8]) -> Mesh {
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).expect("an archive");
    let mut xml = String::new();
    archive.by_name(MODEL).expect("a model").read_to_string(&mut xml).expect("text");
    assert!(xml.contains("unit=\"millimeter\""));
    let numbers = |line: &str| -> Vec<f64> { line.split('"').skip(1).step_by(2).map(|v| v.parse().unwrap()).collect() };
    let triples = |tag: &str| -> Vec<Vec<f64>> { xml.lines().filter(|l| l.starts_with(tag)).map(numbers).collect() };
    let triple = |v: Vec<f64>| [v[0], v[1], v[2]];
    Mesh {
        vertices: triples("<vertex ").into_iter().map(|v| triple(v).map(|c| c as f32)).collect(),
        faces: triples("<triangle ").into_iter().map(|v| triple(v).map(|c| c as u32)).collect(),
        ..Mesh::default()
    }
}
