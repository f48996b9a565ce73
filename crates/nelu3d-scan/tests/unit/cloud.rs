use nelu3d_scan::cloud::{OrganizedCloud, write_e57, write_pcd};

/// Three by two pixels, of which one has no point.
fn cloud() -> OrganizedCloud {
    let positions: Vec<[f32; 3]> = (0..6u8).map(|i| [f32::from(i) - 2.5, 0.25 * f32::from(i), 700.0]).collect();
    let mut cloud = OrganizedCloud {
        width: 3,
        height: 2,
        normals: vec![[0.0, 0.0, -1.0]; 6],
        colors: (0..6u8).map(|i| [10 * i, 20, 255]).collect(),
        sigma: (0..6u8).map(|i| 0.125 * f32::from(i)).collect(),
        positions,
    };
    (cloud.positions[4], cloud.normals[4], cloud.sigma[4]) = ([f32::NAN; 3], [f32::NAN; 3], f32::NAN);
    cloud
}

/// Header and data as the format's description has them, read by its rules and not by the writer's.
#[test]
fn pcd_is_organized_and_has_sigma() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("points.pcd");
    write_pcd(&path, &cloud()).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let mark = b"DATA binary\n";
    let start = bytes.windows(mark.len()).position(|w| w == mark).unwrap() + mark.len();
    let header = std::str::from_utf8(&bytes[..start]).unwrap();
    let field = |name: &str| -> Vec<&str> {
        header.lines().find_map(|l| l.strip_prefix(name)).unwrap().split_whitespace().collect()
    };
    assert_eq!((field("WIDTH"), field("HEIGHT"), field("POINTS")), (vec!["3"], vec!["2"], vec!["6"]));
    let names = field("FIELDS");
    assert_eq!(names.len(), field("SIZE").len());
    let size: usize = field("SIZE").iter().map(|s| s.parse::<usize>().unwrap()).sum();
    assert_eq!(bytes.len() - start, 6 * size);
    let at = |point: usize, name: &str| {
        let offset = start + point * size + 4 * names.iter().position(|n| *n == name).unwrap();
        <[u8; 4]>::try_from(&bytes[offset..offset + 4]).unwrap()
    };
    let expected = cloud();
    for i in 0..6 {
        for (a, name) in ["x", "y", "z"].into_iter().enumerate() {
            assert_eq!(f32::from_le_bytes(at(i, name)).to_bits(), expected.positions[i][a].to_bits());
        }
        assert_eq!(f32::from_le_bytes(at(i, "sigma")).to_bits(), expected.sigma[i].to_bits());
        let rgb = u32::from_le_bytes(at(i, "rgb"));
        assert_eq!([rgb >> 16, rgb >> 8 & 255, rgb & 255], expected.colors[i].map(u32::from));
    }
}

/// The library's reader finds meters, colors, rows, columns, and σ again.
#[test]
fn e57_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("points.e57");
    write_e57(&path, &cloud(), "nelu3d-test").unwrap();
    let mut file = ::e57::E57Reader::from_file(&path).unwrap();
    let described = file.pointclouds().remove(0);
    assert_eq!((described.records, described.guid.as_deref()), (5, Some("nelu3d-test")));
    let expected = cloud();
    let found: Vec<::e57::RawValues> = file.pointcloud_raw(&described).unwrap().map(|p| p.unwrap()).collect();
    assert_eq!(found.len(), 5);
    for values in found {
        let number = |i: usize| match &values[i] {
            ::e57::RecordValue::Single(v) => f64::from(*v),
            ::e57::RecordValue::Integer(v) => *v as f64,
            other => panic!("{other:?}"),
        };
        let i = (number(6) * 3.0 + number(7)) as usize;
        for a in 0..3 {
            assert!((1000.0 * number(a) - f64::from(expected.positions[i][a])).abs() < 1e-3);
            assert_eq!(number(3 + a), f64::from(expected.colors[i][a]));
        }
        assert!((1000.0 * number(8) - f64::from(expected.sigma[i])).abs() < 1e-6);
    }
}

#[test]
fn a_cloud_without_points_is_written_too() {
    let dir = tempfile::tempdir().unwrap();
    let mut empty = cloud();
    empty.positions.fill([f32::NAN; 3]);
    write_pcd(&dir.path().join("a.pcd"), &empty).unwrap();
    write_e57(&dir.path().join("a.e57"), &empty, "nelu3d-empty").unwrap();
}
