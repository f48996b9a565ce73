//! OpenEXR, through the `exr` crate (the `image` crate has no gray EXR).

use std::io::Cursor;

use ::exr::prelude::*;

use super::error::ImageFileError;
use super::file::File;
use super::raw::{Raw, RawData};

/// Most channels of a file, in all of its layers: renderers write some dozens.
const MAX_CHANNELS: usize = 64;

pub(super) fn decode(file: &File<'_>) -> std::result::Result<Raw, ImageFileError> {
    let meta = MetaData::read_from_buffered(Cursor::new(file.bytes), false).map_err(|e| file.damaged(e))?;
    let header = meta.headers.first().ok_or_else(|| file.damaged("it has no layer"))?;
    let Vec2(width, height) = header.layer_size;
    file.check_size(width, height)?;

    // Every channel is unpacked, wanted or not.
    let all: usize = meta.headers.iter().map(|h| h.channels.list.len()).sum();
    if all > MAX_CHANNELS {
        return Err(file.kind(format!("has {all} channels"), "save it with R, G, B or with Y alone"));
    }
    file.check_decoded((width * height).saturating_mul(all * size_of::<f32>()))?;

    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(file.bytes))
        .map_err(|e| file.damaged(e))?;
    let channels = &image.layer_data.channel_data.list;
    let named = |name: &str| channels.iter().find(|c| c.name.to_string() == name);
    let planes: Vec<Vec<f32>> = match (named("R"), named("G"), named("B")) {
        _ if named("A").is_some() => return Err(file.alpha()),
        (Some(r), Some(g), Some(b)) => [r, g, b].map(|c| c.sample_data.values_as_f32().collect()).into(),
        _ if channels.len() == 1 => vec![channels[0].sample_data.values_as_f32().collect()],
        _ => {
            let names: Vec<String> = channels.iter().map(|c| c.name.to_string()).collect();
            return Err(
                file.kind(format!("has the channels {}", names.join(", ")), "save it with R, G, B or with Y alone")
            );
        }
    };
    if planes.iter().any(|p| p.len() != width * height) {
        return Err(file.kind("has subsampled channels", "save every channel in full resolution"));
    }
    let data = match planes.as_slice() {
        [y] => y.clone(),
        [r, g, b] => r.iter().zip(g).zip(b).flat_map(|((&r, &g), &b)| [r, g, b]).collect(),
        _ => unreachable!("one plane or three"),
    };
    file.raw(width, height, planes.len(), RawData::Float(data))
}
