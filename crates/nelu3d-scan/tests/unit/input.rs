use std::io;

use nelu3d_scan::input::{MAX_DATA, open_file, read_file, read_text, shortened};

#[test]
fn regular_files_are_read_up_to_a_size() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.txt");
    std::fs::write(&path, "hello").unwrap();
    assert_eq!(read_file(&path, 5).unwrap(), b"hello");
    assert_eq!(read_text(&path).unwrap(), "hello");
    assert_eq!(open_file(&path).unwrap().1, 5);
    let e = read_file(&path, 4).unwrap_err();
    assert_eq!(e.kind(), io::ErrorKind::FileTooLarge);
    assert!(e.to_string().contains("larger than") && e.to_string().contains("; give the right file"), "{e}");
    // A file that claims a terabyte costs none.
    std::fs::File::create(&path).unwrap().set_len(1 << 40).unwrap();
    assert_eq!(read_file(&path, MAX_DATA).unwrap_err().kind(), io::ErrorKind::FileTooLarge);
    std::fs::write(&path, [b'a', 0xff]).unwrap();
    assert!(read_text(&path).unwrap_err().to_string().contains("no text"));
}

#[test]
fn what_is_no_file_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let e = read_file(dir.path(), 9).unwrap_err().to_string();
    assert_eq!(e, "it is a folder; give a file");
    let e = read_file(&dir.path().join("b"), 9).unwrap_err();
    assert_eq!(e.kind(), io::ErrorKind::NotFound);
    assert!(e.to_string().contains("; correct its name"), "{e}");
}

#[cfg(unix)]
#[test]
fn pipes_and_devices_are_refused_at_once() {
    let dir = tempfile::tempdir().unwrap();
    let pipe = dir.path().join("pipe");
    rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
    for path in [pipe.as_path(), std::path::Path::new("/dev/zero")] {
        let e = read_file(path, MAX_DATA).unwrap_err().to_string();
        assert!(e.contains("a pipe, a socket or a device; give a regular file"), "{e}");
    }
}

#[test]
fn long_reasons_are_cut() {
    assert_eq!(shortened("bad\n tag "), "bad tag");
    let long = shortened(&"ä".repeat(5000));
    assert!(long.chars().count() < 210 && long.ends_with(" …"), "{long}");
}
