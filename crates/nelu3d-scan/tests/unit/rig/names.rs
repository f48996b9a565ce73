use nelu3d_scan::rig::{is_file_name, is_name};

#[test]
fn names_do_not_lead_out() {
    for good in ["a", "sine_00.png", "größe 3", "a..b", "x-1"] {
        assert!(is_name(good) && is_file_name(good), "{good}");
    }
    for bad in ["", ".", "..", "../a", "a/../b", "/dev/zero", "C:\\a", "a\\b", ".hidden", " a", "a\nb", "a\0b"] {
        assert!(!is_name(bad) && !is_file_name(bad), "{bad:?}");
    }
    assert!(is_file_name("left/sine.png") && !is_name("left/sine.png"));
    assert!(!is_file_name("left//sine.png") && !is_name(&"a".repeat(201)));
}
