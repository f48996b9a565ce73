use nelu3d_sim::spec::BoardSpec;

/// As in rig.toml: an outline that is not given is the smallest around the print, and one that is given stays.
#[test]
fn an_outline_need_not_be_given() {
    let chessboard = "kind = \"chessboard\"\ncolumns = 10\nrows = 7\nsquare_mm = 12.0\n";
    let markers = "kind = \"markers\"\ndictionary = \"DICT_4X4_50\"\n[[markers]]\nid = 3\n\
                   corners_mm = [[-5, 2], [15, 2], [15, 22], [-5, 22]]\n";
    for (text, expected) in [(chessboard, [0.0, 0.0, 120.0, 84.0]), (markers, [-5.0, 2.0, 15.0, 22.0])] {
        let spec: BoardSpec = toml::from_str(text).unwrap();
        assert_eq!((spec.extent_mm(), spec.board().extent_mm), (expected, expected));
        assert!(!toml::to_string(&spec).unwrap().contains("extent_mm"));
    }
    let wide: BoardSpec = toml::from_str(&format!("{chessboard}extent_mm = [-10, -10, 130, 94]\n")).unwrap();
    assert_eq!(wide.extent_mm(), [-10.0, -10.0, 130.0, 94.0]);
    assert_eq!(toml::from_str::<BoardSpec>(&toml::to_string(&wide).unwrap()).unwrap(), wide);
}
