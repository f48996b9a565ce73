use nelu3d_evaluate::GroundTruth;
use nelu3d_scan::{Camera, npy};

#[test]
fn a_folder_of_ground_truth_is_read_and_its_faults_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let camera = Camera::pinhole(3, 2, 10.0, 10.0, 1.0, 0.5);
    let read = || GroundTruth::read(dir.path(), &camera);
    assert!(read().unwrap_err().to_string().contains("no depth.npy"));
    let depth = [1.0, 2.0, f32::NAN, 4.0, 5.0, 6.0];
    npy::write(&dir.path().join("depth.npy"), &[2, 3], &depth).unwrap();
    assert!(read().unwrap_err().to_string().contains("no mask.png"));
    let mask = dir.path().join("mask.png");
    nelu3d_scan::image::write_gray8(&mask, 3, 2, &[255, 0, 255, 255, 0, 255]).unwrap();
    let truth = read().unwrap();
    assert_eq!(truth.mask, [true, false, false, true, false, true]);
    assert_eq!(truth.depth[5], 6.0);
    npy::write(&dir.path().join("depth.npy"), &[3, 2], &depth).unwrap();
    assert!(read().unwrap_err().to_string().contains("[3, 2]"));
    nelu3d_scan::image::write_gray8(&mask, 2, 2, &[255; 4]).unwrap();
    npy::write(&dir.path().join("depth.npy"), &[2, 3], &depth).unwrap();
    assert!(read().unwrap_err().to_string().contains("mask.png"));
}
