//! E57 (ASTM E2807), the exchange format of metrology and surveying.

use std::io::Cursor;

use e57::{E57Writer, Extension, Record, RecordDataType, RecordName, RecordValue};

use super::organized::OrganizedCloud;

/// Where the attribute σ is explained.
const NAMESPACE: (&str, &str) = ("nelu3d", "https://docs.rs/nelu3d-scan");

/// Returns the content of the file.
pub(super) fn encode(cloud: &OrganizedCloud, guid: &str) -> Result<Vec<u8>, String> {
    let said = |e: e57::Error| e.to_string();
    let mut bytes = Cursor::new(Vec::new());
    let mut file = E57Writer::new(&mut bytes, &format!("{guid}-file")).map_err(said)?;
    file.register_extension(Extension::new(NAMESPACE.0, NAMESPACE.1)).map_err(said)?;
    file.set_coordinate_metadata(Some("the camera's frame: x right, y down, z forward".into()));
    let float = RecordDataType::Single { min: None, max: None };
    let index = |n: usize| RecordDataType::Integer { min: 0, max: n.saturating_sub(1) as i64 };
    let sigma = RecordName::Unknown { namespace: NAMESPACE.0.into(), name: "sigma".into() };
    let attributes = [
        (RecordName::CartesianX, float.clone()),
        (RecordName::CartesianY, float.clone()),
        (RecordName::CartesianZ, float.clone()),
        (RecordName::ColorRed, index(256)),
        (RecordName::ColorGreen, index(256)),
        (RecordName::ColorBlue, index(256)),
        (RecordName::RowIndex, index(cloud.height)),
        (RecordName::ColumnIndex, index(cloud.width)),
        (sigma, float),
    ];
    let prototype = attributes.map(|(name, data_type)| Record { name, data_type }).to_vec();
    let mut points = file.add_pointcloud(guid, prototype).map_err(said)?;
    points.set_name(Some("nelu3d".into()));
    for i in (0..cloud.positions.len()).filter(|i| cloud.positions[*i].iter().all(|v| v.is_finite())) {
        let meters = |mm: f32| RecordValue::Single(mm / 1000.0);
        let [x, y, z] = cloud.positions[i].map(meters);
        let [r, g, b] = cloud.colors[i].map(|c| RecordValue::Integer(c.into()));
        let [row, column] = [i / cloud.width, i % cloud.width].map(|n| RecordValue::Integer(n as i64));
        points.add_point(vec![x, y, z, r, g, b, row, column, meters(cloud.sigma[i])]).map_err(said)?;
    }
    points.finalize().map_err(said)?;
    file.finalize().map_err(said)?;
    drop(file);
    Ok(bytes.into_inner())
}
