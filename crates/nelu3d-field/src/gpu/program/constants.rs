//! What completes the text of a shader.

/// The completion of a shader: its constants, and the flags that its lines `#if NAME`, `#else`, `#endif` ask for.
#[derive(Clone, Debug, Default)]
pub struct Constants {
    text: String,
    flags: Vec<&'static str>,
}

impl Constants {
    /// Adds a number of things.
    pub fn count(mut self, name: &str, value: usize) -> Self {
        let value = u32::try_from(value).expect("sizes of a kernel fit into 32 bits");
        self.text += &format!("const {name}: u32 = {value}u;\n");
        self
    }

    /// Adds a quantity.
    pub(crate) fn value(mut self, name: &str, value: f64) -> Self {
        self.text += &format!("const {name}: f32 = {:e}f;\n", value as f32);
        self
    }

    /// Includes the lines behind `#if name`.
    pub(crate) fn flag(mut self, name: &'static str, on: bool) -> Self {
        if on {
            self.flags.push(name);
        }
        self
    }

    /// Returns the complete text of a shader.
    pub(super) fn complete(&self, source: &str) -> String {
        let mut out = self.text.clone();
        let mut included = None;
        for line in source.lines() {
            match line.trim().split_once(' ').unwrap_or((line.trim(), "")) {
                ("#if", name) => included = Some(self.flags.contains(&name)),
                ("#else", _) => included = included.map(|is| !is),
                ("#endif", _) => included = None,
                _ if included != Some(false) => {
                    out += line;
                    out.push('\n');
                }
                _ => {}
            }
        }
        out
    }
}

/// The flag that every kernel has on devices whose subgroups' threads see each other's values.
pub(super) const SUBGROUPS: &str = "SUBGROUPS";

/// The beginning of a kernel whose form depends on subgroups.
pub(crate) const PLACE: &str = include_str!("../shaders/place.wgsl");

/// Returns the workgroups for `n` threads of a grid of `size` each, folded into two dimensions: thread
/// `(wid.y * FOLD + wid.x) * size + lid.x`.
pub fn folded(n: usize, size: usize) -> [usize; 3] {
    let groups = n.div_ceil(size).max(1);
    [groups.min(FOLD), groups.div_ceil(FOLD), 1]
}

/// Workgroups along x of a folded grid.
pub const FOLD: usize = 32_768;
