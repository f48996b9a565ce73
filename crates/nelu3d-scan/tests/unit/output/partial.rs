use std::io;

use nelu3d_scan::output::{OutputDir, write_error};

#[test]
fn what_is_under_construction_is_known_until_it_is_done() {
    let dir = tempfile::tempdir().unwrap();
    let out = OutputDir::create(&dir.path().join("result"), "result.json").unwrap();
    let temp = out.path().join("depth.npy");
    let full = io::Error::new(io::ErrorKind::StorageFull, "no space at path \"/x/.depth.npy.a8.partial\"");
    let e = write_error(&temp, &full).to_string();
    let expected = format!("{}: cannot be written: no space; free", dir.path().join("result/depth.npy").display());
    assert!(e.starts_with(&expected), "{e}");
    drop(out);
    let e = write_error(&temp, &full).to_string();
    assert!(e.starts_with(&format!("{}: cannot be written: no space; free", temp.display())), "{e}");
}
