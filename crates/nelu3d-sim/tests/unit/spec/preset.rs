use nelu3d_sim::Spec;
use nelu3d_sim::spec::PRESETS;

#[test]
fn presets_are_sound_and_survive_a_file() {
    for (name, _) in PRESETS {
        let spec = Spec::preset(name).unwrap();
        spec.check().unwrap();
        assert_eq!(toml::from_str::<Spec>(&spec.to_toml()).unwrap(), spec);
    }
    assert!(Spec::preset("none").is_none());
}
