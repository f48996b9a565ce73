use gltf::animation::Interpolation;
use gltf::animation::util::ReadOutputs;
use gltf::{Document, Glb};
use nelu3d_scan::Mesh;
use nelu3d_scan::mesh::AnimatedGlb;

/// A fan of `n` triangles about the i-th place.
fn fan(i: usize, n: usize) -> Mesh {
    let rim = (0..=n).map(|k| (k as f32 / n as f32).sin_cos()).map(|(y, x)| [x + i as f32, y, 500.0]);
    let vertices: Vec<[f32; 3]> = std::iter::once([i as f32, 0.0, 500.0]).chain(rim).collect();
    let colors = vec![[200, 10 * i as u8, 30]; vertices.len()];
    let faces = (0..n as u32).map(|k| [0, k + 1, k + 2]).collect();
    Mesh { vertices, normals: vec![], colors, faces }
}

fn written(fps: f64, meshes: &[Mesh]) -> (Document, Vec<u8>, Vec<u8>) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let mut glb = AnimatedGlb::new(fps);
    for mesh in meshes {
        glb.push(mesh).unwrap();
    }
    glb.write(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let glb = Glb::from_slice(&bytes).unwrap();
    let root = gltf::json::Root::from_slice(&glb.json).unwrap();
    // Checks references and required keys.
    let document = Document::from_json(root).unwrap();
    (document, glb.bin.unwrap().into_owned(), bytes)
}

/// The scale of each node at a time, as a viewer with steps computes it.
fn scales(document: &Document, blob: &[u8], time: f32) -> Vec<f32> {
    let animation = document.animations().next().unwrap();
    let mut scales = vec![f32::NAN; document.nodes().count()];
    for channel in animation.channels() {
        assert_eq!(channel.sampler().interpolation(), Interpolation::Step);
        let reader = channel.reader(|_| Some(blob));
        let times: Vec<f32> = reader.read_inputs().unwrap().collect();
        let Some(ReadOutputs::Scales(values)) = reader.read_outputs() else { panic!("scales") };
        let values: Vec<[f32; 3]> = values.collect();
        assert_eq!((times.len(), times[0]), (values.len(), 0.0));
        assert!(times.is_sorted_by(|a, b| a < b), "{times:?}");
        let step = times.iter().rposition(|&t| t <= time).unwrap();
        assert!(values[step] == [1.0; 3] || values[step] == [0.0; 3]);
        scales[channel.target().node().index()] = values[step][0];
    }
    scales
}

#[test]
fn one_frame_is_shown_at_a_time() {
    for n in [1, 2, 5] {
        let fps = 30.0;
        let meshes: Vec<Mesh> = (0..n).map(|i| fan(i, 3 + i)).collect();
        let (document, blob, _) = written(fps, &meshes);
        assert_eq!((document.nodes().count(), document.meshes().count(), document.animations().count()), (n, n, 1));
        assert_eq!(document.default_scene().unwrap().nodes().count(), n);
        for i in 0..n {
            for part in [0.0, 0.5, 0.99] {
                let scales = scales(&document, &blob, ((i as f64 + part) / fps) as f32);
                let expected: Vec<f32> = (0..n).map(|k| f32::from(u8::from(k == i))).collect();
                assert_eq!(scales, expected, "frame {i} of {n}");
            }
        }
        // The end of the loop is no empty frame.
        assert_eq!(scales(&document, &blob, (n as f64 / fps) as f32).iter().sum::<f32>(), 1.0);
        // Without animation, the first.
        let still: Vec<f32> = document.nodes().map(|n| n.transform().decomposed().2[0]).collect();
        assert_eq!((still[0], still.iter().sum::<f32>()), (1.0, 1.0));
        let duration = document
            .animations()
            .flat_map(|a| a.samplers().map(|s| s.input().max().unwrap()[0].as_f64().unwrap()).collect::<Vec<_>>());
        assert!((duration.fold(0.0, f64::max) - n as f64 / fps).abs() < 1e-6);
    }
}

#[test]
fn every_array_lies_in_the_buffer_and_is_aligned() {
    let meshes = [fan(0, 3), Mesh { faces: vec![], ..fan(1, 4) }, Mesh::default(), fan(3, 70_000)];
    let (document, blob, bytes) = written(12.5, &meshes);
    assert_eq!(bytes.len() % 4, 0);
    let mut ends = Vec::new();
    for accessor in document.accessors() {
        let view = accessor.view().unwrap();
        assert_eq!((view.offset() % 4, accessor.offset()), (0, 0));
        assert_eq!(view.length(), accessor.count() * accessor.size());
        assert!(accessor.count() > 0 && view.offset() + view.length() <= blob.len());
        ends.push((view.offset(), view.offset() + view.length()));
    }
    ends.sort_unstable();
    assert!(ends.windows(2).all(|w| w[0].1 <= w[1].0), "arrays overlap");
    assert!(ends[ends.len() - 1].1.next_multiple_of(4) == document.buffers().next().unwrap().length());

    let nodes: Vec<_> = document.nodes().collect();
    assert!(nodes[2].mesh().is_none());
    for i in [0, 1, 3] {
        let mesh = &meshes[i];
        let primitive = nodes[i].mesh().unwrap().primitives().next().unwrap();
        let reader = primitive.reader(|_| Some(&blob[..]));
        let positions: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
        assert!(
            positions.iter().zip(&mesh.vertices).all(|(p, v)| *p == [v[0] / 1000.0, -v[1] / 1000.0, -v[2] / 1000.0])
        );
        assert_eq!(
            (positions.len(), reader.read_colors(0).unwrap().into_rgb_u8().count()),
            (mesh.vertices.len(), positions.len())
        );
        let corners: Vec<u32> = reader.read_indices().map(|c| c.into_u32().collect()).unwrap_or_default();
        assert_eq!(corners, mesh.faces.as_flattened());
        assert_eq!(reader.read_normals().is_some(), !mesh.faces.is_empty());
        let size = primitive.indices().map(|c| c.size());
        assert_eq!(size, [Some(2), None, None, Some(4)][i]);
    }
}

#[test]
fn read_as_a_mesh_it_is_its_first_frame() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let mut glb = AnimatedGlb::new(10.0);
    glb.push(&fan(0, 3)).unwrap().push(&fan(1, 5)).unwrap();
    glb.write(&path).unwrap();
    assert_eq!(Mesh::read(&path).unwrap().faces, fan(0, 3).faces);
}

#[test]
fn no_frame_is_no_file() {
    let dir = tempfile::tempdir().unwrap();
    let e = AnimatedGlb::new(10.0).write(&dir.path().join("a.glb")).unwrap_err().to_string();
    assert!(e.contains("a.glb") && e.contains("push one first"), "{e}");
    // Frames without anything to see are frames.
    let (document, blob, _) = written(10.0, &[Mesh::default(), fan(0, 3)]);
    assert_eq!(scales(&document, &blob, 0.05), [1.0, 0.0]);
}
