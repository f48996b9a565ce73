use nelu3d::color_field::checkpoint::checksum::{checksum, with_checksum, without_checksum};

#[test]
fn a_checksum_goes_on_and_off() {
    let json = "{\"a\":1}";
    let sum = checksum(json, [("x", &[1u8, 2][..]), ("b", &[3][..])]);
    assert_eq!(sum, checksum(json, [("b", &[3u8][..]), ("x", &[1, 2][..])]), "the order does not matter");
    assert_ne!(sum, checksum(json, [("b", &[3u8, 1][..]), ("x", &[2][..])]), "what is where does");
    let whole = with_checksum(json, &sum);
    assert!(serde_json::from_str::<serde_json::Value>(&whole).is_ok());
    assert_eq!(without_checksum(&whole), Some((json.to_owned(), &sum[..])));
    assert_eq!(without_checksum(json), None);
}
