use nelu3d::result::ExtraFiles;
use nelu3d::result::extra::{guid, position, texture_coordinates};
use nelu3d::surface::{PixelStatus, Surface};
use nelu3d_scan::camera::Distortion;
use nelu3d_scan::{Camera, Image, Mesh};

/// A slanted plane before a camera with a distorting lens; every pixel is a vertex, and the last has no depth.
fn plane() -> (Surface, Camera) {
    let (width, height) = (9, 7);
    let lens = Distortion::new(&[-0.1, 0.02, 1e-3, -1e-3, 0.0]).unwrap();
    let camera = Camera { distortion: lens, ..Camera::pinhole(width, height, 10.0, 11.0, 3.5, 2.5) };
    let n = width * height;
    let mut surface = Surface {
        width,
        height,
        depth: (0..n).map(|i| 500.0 + (i % width) as f32).collect(),
        normals: vec![[0.6, 0.0, -0.8]; n],
        sigma: vec![0.25; n],
        status: vec![PixelStatus::Valid; n],
        residual: vec![0.01; n],
        ambient: vec![0.5; n],
        white: Image { width, height, channels: 1, data: (0..n).map(|i| i as f32 / n as f32).collect() },
        mesh: Mesh::default(),
    };
    surface.depth[n - 1] = f32::NAN;
    let vertices: Vec<[f32; 3]> = (0..n).map(|i| position(&surface, &camera, i)).filter(|p| p[0].is_finite()).collect();
    surface.mesh = Mesh { vertices, faces: vec![[0, 9, 1], [1, 9, 10]], ..Mesh::default() };
    (surface, camera)
}

/// The picture's places are the pixels that the vertices come from, whatever the lens.
#[test]
fn vertices_lie_on_their_pixels() {
    let (surface, camera) = plane();
    for (i, [u, v]) in texture_coordinates(&surface, &camera).into_iter().enumerate() {
        let (x, y) = (u * 9.0 - 0.5, v * 7.0 - 0.5);
        assert!((x - (i % 9) as f32).abs() < 1e-3 && (y - (i / 9) as f32).abs() < 1e-3, "{i}: {x} {y}");
    }
}

/// Every name writes its file and no other, and maps are read back bit for bit.
#[test]
fn every_file_is_written_by_its_name() {
    let (surface, camera) = plane();
    for name in ExtraFiles::NAMES {
        let dir = tempfile::tempdir().unwrap();
        let mut files = ExtraFiles::default();
        assert!(files.add(name) && files != ExtraFiles::default());
        files.write(dir.path(), &surface, &camera).unwrap();
        let mut found: Vec<String> =
            std::fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        found.sort();
        let expected: &[&str] = match name {
            "textured-obj" => &["textured.mtl", "textured.obj", "textured.png"],
            "textured-glb" => &["textured.glb"],
            "pcd" => &["points.pcd"],
            "e57" => &["points.e57"],
            "tiff" => &["depth.tiff"],
            "exr" => &["depth.exr"],
            _ => &[&format!("mesh.{name}")],
        };
        assert_eq!(found, expected, "{name}");
        if let "tiff" | "exr" = name {
            // What is not finite no image may hold: the reader of captures says so, and where.
            let raw = nelu3d_scan::image::decode(&dir.path().join(&found[0]), Some((9, 7))).unwrap();
            let nelu3d_scan::image::RawData::Float(data) = raw.data else { panic!("floats") };
            assert!(data.iter().zip(&surface.depth).all(|(a, b)| a.to_bits() == b.to_bits()), "{name}");
        }
    }
    assert!(!ExtraFiles::default().add("dwg"));
    assert_eq!(guid(&surface.depth), guid(&surface.depth.clone()));
}
