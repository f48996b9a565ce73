use std::io::Write as _;
use std::path::Path;
use std::{fs, io};

use nelu3d_scan::output::{AtomicFile, ReservedPath, write_atomic};

use crate::output::names;

#[test]
fn a_failed_write_leaves_the_old_file_and_no_other() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.txt");
    write_atomic(&path, |w| w.write_all(b"first")).unwrap();
    let e = write_atomic(&path, |w| {
        w.write_all(&[0; 100_000])?;
        Err(io::ErrorKind::StorageFull.into())
    })
    .unwrap_err();
    assert_eq!(e.kind(), io::ErrorKind::StorageFull);
    assert!(e.to_string().contains("a.txt") && e.to_string().contains("free space"), "{e}");
    assert_eq!(fs::read(&path).unwrap(), b"first");
    assert_eq!(names(dir.path()), ["a.txt"]);
}

/// What a killed run left goes when the file is written again; what a running one has in hand stays, and so do
/// other files' parts.
#[test]
fn abandoned_parts_are_removed() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    let mut live = AtomicFile::create(&path).unwrap();
    for name in [".a.png.Xy12z3.partial", ".a.png.b.Xy12z3.partial", ".b.png.Xy12z3.partial", ".a.png.Xy12z3"] {
        fs::write(dir.path().join(name), "half").unwrap();
    }
    write_atomic(&path, |w| w.write_all(b"first")).unwrap();
    live.write_all(b"second").unwrap();
    live.commit().unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"second");
    assert_eq!(names(dir.path()), [".a.png.Xy12z3", ".a.png.b.Xy12z3.partial", ".b.png.Xy12z3.partial", "a.png"]);
}

#[test]
fn a_missing_folder_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("no/such/a.txt");
    let e = write_atomic(&path, |_| Ok(())).unwrap_err();
    assert!(e.to_string().contains("a.txt") && e.to_string().contains("create its folder"), "{e}");
}

#[cfg(unix)]
#[test]
fn files_are_not_private() {
    use std::os::unix::fs::PermissionsExt;
    let dir = tempfile::tempdir().unwrap();
    let (plain, atomic) = (dir.path().join("plain"), dir.path().join("atomic"));
    fs::write(&plain, b"x").unwrap();
    write_atomic(&atomic, |w| w.write_all(b"x")).unwrap();
    let mode = |p: &Path| fs::metadata(p).unwrap().permissions().mode();
    assert_eq!(mode(&plain), mode(&atomic));
}

#[test]
fn a_place_is_tried_and_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("fields/new/a.txt");
    let place = ReservedPath::new(&path).unwrap();
    assert!(names(path.parent().unwrap()).is_empty());
    drop(place);
    assert!(names(dir.path()).is_empty());
    let place = ReservedPath::new(&path).unwrap();
    write_atomic(&path, |w| w.write_all(b"x")).unwrap();
    drop(place);
    assert_eq!(fs::read(&path).unwrap(), b"x");

    let e = ReservedPath::new(&path.join("b.txt")).unwrap_err().to_string();
    assert!(e.contains("a.txt/b.txt") && e.contains("choose another"), "{e}");
    let e = ReservedPath::new(dir.path()).unwrap_err().to_string();
    assert!(e.contains("choose another name"), "{e}");
}

#[cfg(unix)]
#[test]
fn links_are_followed_and_devices_kept() {
    let dir = tempfile::tempdir().unwrap();
    let (file, link) = (dir.path().join("file"), dir.path().join("link"));
    fs::write(&file, b"old").unwrap();
    std::os::unix::fs::symlink(&file, &link).unwrap();
    write_atomic(&link, |w| w.write_all(b"new")).unwrap();
    assert_eq!(fs::read(&file).unwrap(), b"new");
    assert!(link.is_symlink());
    // A socket stands for the device: replacing it would harm nobody should this test fail.
    let socket = dir.path().join("socket");
    let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    let e = write_atomic(&socket, |w| w.write_all(b"x")).unwrap_err().to_string();
    assert!(e.contains("socket") && e.contains("choose another name"), "{e}");
    assert!(ReservedPath::new(&socket).is_err() && socket.exists() && !socket.is_file());
}
