use nelu3d_scan::rig::natural_order;

#[test]
fn names_sort_as_people_count() {
    let mut names = ["p10", "p9", "p", "p009", "q1", "p9b", "10", "9", "p9a"];
    names.sort_by(|a, b| natural_order(a, b));
    assert_eq!(names, ["9", "10", "p", "p009", "p9", "p9a", "p9b", "p10", "q1"]);
}
