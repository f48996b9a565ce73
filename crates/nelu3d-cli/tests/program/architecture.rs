//! Holds the sources to ARCHITECTURE.md: no loops between files, and no dependency against the crates or the layers.
//!
//! Every path in the code, in `use` lines or inside of expressions, is followed through re-exports to the file that
//! defines the item; the file that names it then depends on that file. A re-export alone is no dependency: it gives a
//! name and uses nothing. What stands below `#[cfg(test)]` does not count. Calls of methods name no file and are not
//! seen; the types that have them are.

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use proc_macro2::{Delimiter, TokenStream, TokenTree};

/// Which crates a crate may use.
const CRATES: &[(&str, &[&str])] = &[
    ("nelu3d-scan", &[]),
    ("nelu3d-field", &[]),
    ("nelu3d", METHOD_MAY_USE),
    ("nelu3d-baselines", ABOVE_THE_METHOD_MAY_USE),
    ("nelu3d-evaluate", ABOVE_THE_METHOD_MAY_USE),
    ("nelu3d-sim", ABOVE_THE_METHOD_MAY_USE),
    ("nelu3d-capture", ABOVE_THE_METHOD_MAY_USE),
    ("nelu3d-report", &["nelu3d-scan", "nelu3d", "nelu3d-evaluate"]),
    ("nelu3d-cli", PROGRAM_MAY_USE),
    ("nelu3d-py", PACKAGE_MAY_USE),
];
const METHOD_MAY_USE: &[&str] = &["nelu3d-scan", "nelu3d-field"];
const ABOVE_THE_METHOD_MAY_USE: &[&str] = &["nelu3d-scan", "nelu3d-field", "nelu3d"];
const PROGRAM_MAY_USE: &[&str] = &[
    "nelu3d-scan",
    "nelu3d-field",
    "nelu3d",
    "nelu3d-baselines",
    "nelu3d-evaluate",
    "nelu3d-sim",
    "nelu3d-capture",
    "nelu3d-report",
];
/// The Python package runs the program.
const PACKAGE_MAY_USE: &[&str] = &[
    "nelu3d-scan",
    "nelu3d-field",
    "nelu3d",
    "nelu3d-baselines",
    "nelu3d-evaluate",
    "nelu3d-sim",
    "nelu3d-report",
    "nelu3d-cli",
];

/// The layers of `crates/nelu3d/src`, lowest first: a folder uses itself and lower layers, never its neighbor.
const LAYERS: &[&[&str]] = &[
    &["progress", "verdict"],
    &["surface"],
    &["sensor"],
    &["color_field"],
    &["calibrate"],
    &["drift"],
    &["reconstruct"],
    &["from_projector", "sequence"],
    &["result"],
];

/// Folders whose `mod.rs` may be used by its variants although it uses them: it states what each of them promises.
const CONCEPTS: &[&str] = &[];

#[test]
fn no_two_files_need_each_other() {
    let loops = workspace().loops(CONCEPTS);
    assert!(loops.is_empty(), "{} groups of files import each other in a loop:\n\n{}", loops.len(), loops.join("\n"));
}

#[test]
fn crates_use_only_what_is_below_them() {
    let mut wrong = workspace().against_crates();
    for (name, dir) in packages() {
        for used in dependencies(&dir).filter(|used| used.starts_with("nelu3d")) {
            if !may_use(&name, &used) {
                wrong.push(format!("{}/Cargo.toml depends on {used}", dir.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "against the crates of ARCHITECTURE.md:\n{}", wrong.join("\n"));
}

#[test]
fn folders_of_the_method_use_only_lower_layers() {
    let wrong = workspace().against_layers();
    assert!(wrong.is_empty(), "against the layers of ARCHITECTURE.md:\n{}", wrong.join("\n"));
}

/// Files that open others in ways of their own: to lock folders, to read tables of the system, and to copy what this
/// program wrote.
const READERS: &[&str] = &[
    "crates/nelu3d-scan/src/output/folder.rs",
    "crates/nelu3d/src/result/summary.rs",
    "crates/nelu3d-baselines/src/lookup3d/shape.rs",
    "crates/nelu3d-cli/src/signals.rs",
    "crates/nelu3d-cli/src/commands/sequence/outputs.rs",
];

/// Regular files up to a size are read through `nelu3d_scan::input`, never pipes, devices, or whatever a name leads to.
#[test]
fn files_are_read_in_one_place() {
    let all = workspace();
    let reads = |path: &&Vec<String>| {
        let names: Vec<&str> = path.iter().map(String::as_str).collect();
        matches!(names[..], [.., "fs", "read" | "read_to_string"] | [.., "File", "open"])
    };
    let modules = all.modules.iter().filter(|m| !READERS.contains(&m.file.as_str()));
    let wrong: Vec<String> = modules
        .flat_map(|m| m.paths.iter().filter(reads).map(|path| format!("{} names {}", m.file, path.join("::"))))
        .collect();
    assert!(wrong.is_empty(), "not through nelu3d_scan::input:\n{}", wrong.join("\n"));
    let found = |file: &&&str| all.modules.iter().any(|m| m.file == **file && m.paths.iter().any(|p| reads(&p)));
    let stale: Vec<_> = READERS.iter().filter(|file| !found(file)).collect();
    assert!(stale.is_empty(), "these read nothing any more: {stale:?}");
}

fn may_use(user: &str, used: &str) -> bool {
    CRATES.iter().any(|(name, below)| *name == user && below.contains(&used))
}

/// The height of a file of the method, `None` for one that is in no layer, and the folder that it is in.
fn layer(file: &str) -> Option<(usize, &str)> {
    let folder = file.strip_prefix("crates/nelu3d/src/")?.split('/').next()?.trim_end_matches(".rs");
    Some((LAYERS.iter().position(|layer| layer.contains(&folder))?, folder))
}

// ---- The sources ----

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

fn toml_file(path: &Path) -> toml::Table {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display())).parse().unwrap()
}

/// Names and folders of the workspace's packages.
fn packages() -> Vec<(String, PathBuf)> {
    let folders = std::fs::read_dir(root().join("crates")).expect("a folder of crates");
    let folders = folders.map(|entry| Path::new("crates").join(entry.unwrap().file_name()));
    let mut folders: Vec<PathBuf> = folders.filter(|dir| root().join(dir).join("Cargo.toml").exists()).collect();
    folders.sort();
    let name =
        |dir: &Path| toml_file(&root().join(dir).join("Cargo.toml"))["package"]["name"].as_str().unwrap().to_owned();
    folders.into_iter().map(|dir| (name(&dir), dir)).collect()
}

/// What a package depends on outside of its tests.
fn dependencies(dir: &Path) -> impl Iterator<Item = String> {
    fn names(table: &toml::Table) -> Vec<String> {
        let nested = table.get("target").and_then(toml::Value::as_table).into_iter().flatten();
        let mut all: Vec<String> = nested.filter_map(|(_, t)| t.as_table()).flat_map(names).collect();
        for section in ["dependencies", "build-dependencies"] {
            all.extend(table.get(section).and_then(toml::Value::as_table).into_iter().flat_map(|t| t.keys().cloned()));
        }
        all
    }
    names(&toml_file(&root().join(dir).join("Cargo.toml"))).into_iter()
}

fn workspace() -> Workspace {
    let read = |file: &str| std::fs::read_to_string(root().join(file)).ok();
    let mut all = Workspace::default();
    for (name, dir) in packages() {
        let main = ["src/lib.rs", "src/main.rs"].map(|f| dir.join(f).to_str().unwrap().to_owned());
        let main = main.into_iter().find(|f| root().join(f).exists()).expect("a library or a program");
        all.add(&name, &main, &read);
    }
    all
}

// ---- Modules and what they name ----

/// All modules of all crates.
#[derive(Default)]
struct Workspace {
    modules: Vec<Module>,
    /// Root modules by the crates' names in code.
    roots: BTreeMap<String, usize>,
}

#[derive(Default)]
struct Module {
    crate_name: String,
    file: String,
    parent: Option<usize>,
    children: HashMap<String, usize>,
    /// Items that are defined here.
    items: BTreeSet<String>,
    /// Imported names and their paths.
    imports: Vec<(String, Vec<String>)>,
    /// Modules all of whose names are imported.
    globs: Vec<Vec<String>>,
    /// Paths that code here names: imports that are not re-exported, and paths inside of expressions and types.
    paths: BTreeSet<Vec<String>>,
}

/// Where a path leads: to a module, or to an item of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Target {
    Module(usize),
    Item(usize),
}

impl Workspace {
    /// Adds a crate whose files are read by `read`.
    fn add(&mut self, crate_name: &str, main: &str, read: &dyn Fn(&str) -> Option<String>) {
        let root = self.modules.len();
        self.roots.insert(crate_name.replace('-', "_"), root);
        self.modules.push(Module { crate_name: crate_name.into(), file: main.into(), ..Module::default() });
        let dir = main.rsplit_once('/').map_or("", |(dir, _)| dir);
        self.parse(root, dir, &tokens(main, &read(main).expect("the crate's main file")), read);
    }

    /// Reads a module's items; files of its children lie in `dir`.
    fn parse(&mut self, id: usize, dir: &str, tokens: &[TokenTree], read: &dyn Fn(&str) -> Option<String>) {
        let mut rest = tokens;
        while let Some(item) = next_item(&mut rest) {
            if item.iter().any(is_cfg_test) {
                continue;
            }
            let word = |i: usize| item.get(i).map(ToString::to_string).unwrap_or_default();
            let at = keyword(item);
            match word(at).as_str() {
                "mod" => self.add_child(id, dir, &word(at + 1), item.last(), read),
                "struct" | "enum" | "union" | "trait" | "type" | "fn" | "const" | "static" => {
                    self.modules[id].items.insert(word(at + 1));
                    self.scan(id, item);
                }
                "macro_rules" => {
                    self.modules[id].items.insert(word(at + 2));
                    self.scan(id, item);
                }
                _ => self.scan(id, item),
            }
        }
    }

    fn add_child(
        &mut self,
        id: usize,
        dir: &str,
        name: &str,
        body: Option<&TokenTree>,
        read: &dyn Fn(&str) -> Option<String>,
    ) {
        let (child, mut file) = (self.modules.len(), self.modules[id].file.clone());
        let tokens: Vec<TokenTree> = match body {
            Some(TokenTree::Group(group)) => group.stream().into_iter().collect(),
            _ => {
                let files = [format!("{dir}/{name}.rs"), format!("{dir}/{name}/mod.rs")];
                let found = files.into_iter().find_map(|f| read(&f).map(|text| (f, text)));
                // A module without a file is the compiler's to complain about.
                let (f, text) = found.unwrap_or_else(|| (format!("{dir}/{name}.rs"), String::new()));
                file = f;
                tokens(&file, &text)
            }
        };
        let crate_name = self.modules[id].crate_name.clone();
        self.modules.push(Module { crate_name, file, parent: Some(id), ..Module::default() });
        self.modules[id].children.insert(name.into(), child);
        self.parse(child, &format!("{dir}/{name}"), &tokens, read);
    }

    /// Collects imports and paths, inside of bodies too.
    fn scan(&mut self, id: usize, tokens: &[TokenTree]) {
        let mut i = 0;
        while i < tokens.len() {
            if is_ident(tokens.get(i), "use") && !is_punct(tokens.get(i + 1), '<') {
                let end = (i..tokens.len()).find(|&k| is_punct(tokens.get(k), ';')).unwrap_or(tokens.len());
                let public = tokens[..i].iter().any(|t| is_ident(Some(t), "pub"));
                self.import(id, &[], &tokens[i + 1..end], public);
                i = end;
            } else if is_cfg_test(&tokens[i]) {
                // A statement, a field or a method for tests alone.
                let end = |t: &TokenTree| {
                    is_punct(Some(t), ';') || matches!(t, TokenTree::Group(g) if g.delimiter() == Delimiter::Brace)
                };
                i = (i + 1..tokens.len()).find(|&k| end(&tokens[k])).unwrap_or(tokens.len());
            } else if let TokenTree::Group(group) = &tokens[i] {
                self.scan(id, &group.stream().into_iter().collect::<Vec<_>>());
            } else if let TokenTree::Ident(first) = &tokens[i] {
                // Neither a method or field, nor a lifetime.
                let before = i.checked_sub(1).and_then(|k| tokens.get(k));
                let alone = !is_punct(before, '.') && !is_punct(before, '\'');
                let mut path = vec![first.to_string()];
                while is_punct(tokens.get(i + 1), ':') && is_punct(tokens.get(i + 2), ':') {
                    let Some(TokenTree::Ident(next)) = tokens.get(i + 3) else { break };
                    path.push(next.to_string());
                    i += 3;
                }
                // `name:` is a field or a parameter.
                if path.len() > 1 || (alone && !is_punct(tokens.get(i + 1), ':')) {
                    self.modules[id].paths.insert(path);
                }
            }
            i += 1;
        }
    }

    /// One tree of a `use` line.
    fn import(&mut self, id: usize, prefix: &[String], tree: &[TokenTree], public: bool) {
        for branch in tree.split(|t| is_punct(Some(t), ',')).filter(|b| !b.is_empty()) {
            let mut path = prefix.to_vec();
            let mut name = None;
            for (i, token) in branch.iter().enumerate() {
                match token {
                    TokenTree::Group(group) => {
                        let inner: Vec<TokenTree> = group.stream().into_iter().collect();
                        self.import(id, &path, &inner, public);
                        path.clear();
                    }
                    TokenTree::Ident(word) if word == "as" => {
                        name = branch.get(i + 1).map(ToString::to_string);
                        break;
                    }
                    TokenTree::Ident(word) if word == "self" && !path.is_empty() => {}
                    TokenTree::Ident(word) => path.push(word.to_string()),
                    TokenTree::Punct(p) if p.as_char() == '*' => {
                        self.modules[id].globs.push(std::mem::take(&mut path));
                    }
                    _ => {}
                }
            }
            if let Some(last) = path.last() {
                let name = name.unwrap_or_else(|| last.clone());
                if !public {
                    self.modules[id].paths.insert(path.clone());
                }
                self.modules[id].imports.push((name, path));
            }
        }
    }

    // ---- Where paths lead ----

    /// What a path means in a module; nothing if it leads out of the workspace.
    fn resolve(&self, module: usize, path: &[String], open: &mut Vec<(usize, String)>) -> BTreeSet<Target> {
        let (first, rest) = path.split_first().expect("a path has a name");
        let mut root = module;
        while let Some(parent) = self.modules[root].parent {
            root = parent;
        }
        let mut found = match first.as_str() {
            "crate" => BTreeSet::from([Target::Module(root)]),
            "self" => BTreeSet::from([Target::Module(module)]),
            "super" => self.modules[module].parent.map(Target::Module).into_iter().collect(),
            name => self.lookup(module, name, open),
        };
        if let (true, Some(&other)) = (found.is_empty(), self.roots.get(first)) {
            found.insert(Target::Module(other));
        }
        for name in rest {
            let step = |target: &Target| match *target {
                Target::Module(id) if name == "super" => {
                    self.modules[id].parent.map(Target::Module).into_iter().collect()
                }
                Target::Module(id) => self.lookup(id, name, open),
                // A variant, a function or a constant of a type.
                Target::Item(id) => BTreeSet::from([Target::Item(id)]),
            };
            found = found.iter().flat_map(step).collect();
        }
        found
    }

    /// What a name means in a module: a type, a function and a module may share one.
    fn lookup(&self, module: usize, name: &str, open: &mut Vec<(usize, String)>) -> BTreeSet<Target> {
        // Globs may import each other's names in a ring.
        let question = (module, name.to_owned());
        if open.contains(&question) {
            return BTreeSet::new();
        }
        open.push(question);
        let m = &self.modules[module];
        let mut found: BTreeSet<Target> = m.children.get(name).map(|&id| Target::Module(id)).into_iter().collect();
        if m.items.contains(name) {
            found.insert(Target::Item(module));
        }
        for (_, path) in m.imports.iter().filter(|(imported, _)| imported == name) {
            found.extend(self.resolve(module, path, open));
        }
        if found.is_empty() {
            for glob in &m.globs {
                for target in self.resolve(module, glob, open) {
                    if let Target::Module(id) = target {
                        found.extend(self.lookup(id, name, open));
                    }
                }
            }
        }
        open.pop();
        found
    }

    /// Every pair of files of which the first needs the second, with a path by which it does.
    fn edges(&self) -> BTreeMap<(usize, usize), String> {
        // The first module of each file stands for it.
        let mut first: HashMap<&str, usize> = HashMap::new();
        for (id, m) in self.modules.iter().enumerate() {
            first.entry(&m.file).or_insert(id);
        }
        let mut edges = BTreeMap::new();
        for (id, m) in self.modules.iter().enumerate() {
            for path in &m.paths {
                for target in self.resolve(id, path, &mut Vec::new()) {
                    let Target::Item(to) = target else { continue };
                    let pair = (first[m.file.as_str()], first[self.modules[to].file.as_str()]);
                    if pair.0 != pair.1 {
                        edges.entry(pair).or_insert_with(|| path.join("::"));
                    }
                }
            }
        }
        edges
    }

    // ---- The rules ----

    /// A shortest loop of every group of files that need each other, largest group first. In a folder of `concepts` its
    /// files may use `mod.rs`.
    fn loops(&self, concepts: &[&str]) -> Vec<String> {
        let mut edges = self.edges();
        edges.retain(|&(from, to), _| {
            let (from, to) = (&self.modules[from].file, &self.modules[to].file);
            let folder = to.strip_suffix("/mod.rs").filter(|folder| concepts.contains(folder));
            !folder.is_some_and(|folder| from.strip_prefix(folder).is_some_and(|rest| rest.starts_with('/')))
        });
        let reach = |from: usize| -> BTreeMap<usize, usize> {
            // Each file that is reached, and the one before it.
            let mut before = BTreeMap::new();
            let mut open = VecDeque::from([from]);
            while let Some(at) = open.pop_front() {
                for (&(_, to), _) in edges.range((at, 0)..(at + 1, 0)) {
                    if let std::collections::btree_map::Entry::Vacant(entry) = before.entry(to) {
                        entry.insert(at);
                        open.push_back(to);
                    }
                }
            }
            before
        };
        let reached: Vec<BTreeMap<usize, usize>> = (0..self.modules.len()).map(reach).collect();
        let mut groups = BTreeSet::new();
        for from in (0..self.modules.len()).filter(|&i| reached[i].contains_key(&i)) {
            groups.insert(
                reached[from].keys().copied().filter(|&to| reached[to].contains_key(&from)).collect::<Vec<_>>(),
            );
        }
        let mut groups: Vec<Vec<usize>> = groups.into_iter().collect();
        groups.sort_by_key(|g| std::cmp::Reverse(g.len()));
        let loop_of = |group: &Vec<usize>| {
            let around = |&start: &usize| {
                let mut steps = vec![start, reached[start][&start]];
                while steps[steps.len() - 1] != start {
                    steps.push(reached[start][&steps[steps.len() - 1]]);
                }
                steps.reverse();
                steps
            };
            let shortest = group.iter().map(around).min_by_key(Vec::len).expect("a group has files");
            let mut text = format!("{} files, for example\n", group.len());
            for step in shortest.windows(2) {
                let [from, to] = [step[0], step[1]].map(|i| &self.modules[i].file);
                text += &format!("  {from} names {}\n    of {to}\n", edges[&(step[0], step[1])]);
            }
            let files: Vec<&str> = group.iter().map(|&i| self.modules[i].file.as_str()).collect();
            text + &format!("  all: {}\n", files.join(", "))
        };
        groups.iter().map(loop_of).collect()
    }

    /// Files that use another crate than theirs may.
    fn against_crates(&self) -> Vec<String> {
        let unknown = self.roots.values().map(|&root| &self.modules[root].crate_name);
        let unknown = unknown.filter(|name| CRATES.iter().all(|(known, _)| known != name));
        let mut wrong: Vec<String> = unknown.map(|name| format!("{name} is not in the diagram")).collect();
        wrong.extend(
            self.wrong_edges(|from, to| from.crate_name == to.crate_name || may_use(&from.crate_name, &to.crate_name)),
        );
        wrong
    }

    /// Files of the method that are in no layer, or use a higher one.
    fn against_layers(&self) -> Vec<String> {
        const MAIN: &str = "crates/nelu3d/src/lib.rs";
        let files: BTreeSet<&str> = self.modules.iter().map(|m| m.file.as_str()).collect();
        let mine = files.into_iter().filter(|f| f.starts_with("crates/nelu3d/src/") && *f != MAIN);
        let mut wrong: Vec<String> =
            mine.filter(|f| layer(f).is_none()).map(|f| format!("{f} is in no layer")).collect();
        wrong.extend(self.wrong_edges(|from, to| match (layer(&from.file), layer(&to.file)) {
            (Some((above, a)), Some((below, b))) => above > below || a == b,
            // Nothing is defined in the main file that others use.
            (Some(_), None) => to.file != MAIN,
            (None, _) => true,
        }));
        wrong
    }

    fn wrong_edges(&self, right: impl Fn(&Module, &Module) -> bool) -> Vec<String> {
        let edges = self.edges().into_iter().map(|((from, to), path)| (&self.modules[from], &self.modules[to], path));
        let wrong = edges.filter(|(from, to, _)| !right(from, to));
        wrong.map(|(from, to, path)| format!("{} names {path} of {}", from.file, to.file)).collect()
    }
}

// ---- Tokens ----

fn tokens(file: &str, text: &str) -> Vec<TokenTree> {
    TokenStream::from_str(text).unwrap_or_else(|e| panic!("{file}: {e}")).into_iter().collect()
}

fn is_punct(token: Option<&TokenTree>, c: char) -> bool {
    matches!(token, Some(TokenTree::Punct(p)) if p.as_char() == c)
}

fn is_ident(token: Option<&TokenTree>, word: &str) -> bool {
    matches!(token, Some(TokenTree::Ident(i)) if i == word)
}

/// Whether a token is the bracket of `#[cfg(test)]`, or of one that needs `test` and more.
fn is_cfg_test(token: &TokenTree) -> bool {
    let text: String = match token {
        TokenTree::Group(g) if g.delimiter() == Delimiter::Bracket => g.stream().to_string(),
        _ => return false,
    };
    let text: String = text.split_whitespace().collect();
    text == "cfg(test)" || text.starts_with("cfg(all(test,")
}

/// Where the word stands that says what an item is, after attributes, visibility and modifiers.
fn keyword(item: &[TokenTree]) -> usize {
    let skipped = |i: usize| match &item[i] {
        TokenTree::Group(_) | TokenTree::Literal(_) => true,
        TokenTree::Punct(p) => ['#', '!'].contains(&p.as_char()),
        TokenTree::Ident(word) => match word.to_string().as_str() {
            "pub" | "unsafe" | "async" | "extern" | "default" => true,
            "const" => ["fn", "unsafe", "async", "extern"].iter().any(|next| is_ident(item.get(i + 1), next)),
            _ => false,
        },
    };
    (0..item.len()).find(|&i| !skipped(i)).unwrap_or(0)
}

/// Takes the tokens of the next item of a module, with its attributes: up to its body or a semicolon.
fn next_item<'a>(rest: &mut &'a [TokenTree]) -> Option<&'a [TokenTree]> {
    if rest.is_empty() {
        return None;
    }
    // Braces of these are no bodies.
    let at = keyword(rest);
    let bodiless = ["use", "const", "static", "type"].iter().any(|word| is_ident(rest.get(at), word));
    let end = (at..rest.len()).find(|&i| match &rest[i] {
        TokenTree::Group(g) => !bodiless && g.delimiter() == Delimiter::Brace,
        token => is_punct(Some(token), ';'),
    });
    let (item, after) = rest.split_at(end.map_or(rest.len(), |i| i + 1));
    *rest = after;
    Some(item)
}

// ---- The test is a test ----

/// A workspace in memory: a crate's name, and its files below `crates/<name>/src`.
fn tiny(crates: &[(&str, &[(&str, &str)])]) -> Workspace {
    let mut all = Workspace::default();
    for (name, files) in crates {
        let dir = format!("crates/{name}/src/");
        let read = |file: &str| {
            let found = files.iter().find(|(path, _)| file == format!("{dir}{path}"));
            found.map(|(_, text)| (*text).to_owned())
        };
        all.add(name, &format!("{dir}lib.rs"), &read);
    }
    all
}

/// One crate, whose loops are counted by their files.
fn loop_sizes(files: &[(&str, &str)]) -> Vec<usize> {
    let loops = tiny(&[("nelu3d", files)]).loops(&[]);
    loops.iter().map(|text| text.split(' ').next().unwrap().parse().unwrap()).collect()
}

#[test]
fn loops_are_found() {
    let main = "mod a; mod b; mod c;";
    // Through a re-export, to the file that defines the item.
    let a = "mod inner; pub use inner::{Thing, Other as Renamed};";
    let inner = "use crate::b; pub struct Thing; pub struct Other; fn f() -> u8 { b::g() }";
    for (b, c, expected) in [
        ("pub fn g() -> u8 { 0 }", "use crate::a::Thing;", vec![]),
        ("pub fn g() -> u8 { let x = super::a::Renamed; 0 }", "", vec![2]),
        ("use crate::a::*; pub fn g(_: Thing) {}", "", vec![2]),
        ("pub fn g() { crate::c::h() }", "pub fn h() { assert!(crate::a::Thing != 1) }", vec![3]),
        ("pub fn g() { use crate::a::Thing as T; }", "", vec![2]),
        // Neither tests nor comments nor strings are code.
        ("pub fn g() {} // crate::a::Thing\n#[cfg(test)] mod tests { use crate::a::Thing; }", "", vec![]),
        ("pub fn g() { #[cfg(test)] { crate::a::Thing; } \"crate::a::Thing\"; }", "", vec![]),
        // What another file re-exports is not its own.
        ("pub fn g() {} pub use crate::a::Thing;", "use crate::b::Thing;", vec![]),
        // Braces that end no item, and items that begin with much else.
        (
            "const K: T = T { x: 1 }; #[a] pub(crate) const unsafe fn g<A: B<C = u8>>() { crate::a::Thing::new() }",
            "",
            vec![2],
        ),
    ] {
        let files = [("lib.rs", main), ("a/mod.rs", a), ("a/inner.rs", inner), ("b.rs", b), ("c.rs", c)];
        assert_eq!(loop_sizes(&files), expected, "{b} {c}");
    }
    // A parent and a child: the promise in one, a variant in the other.
    let child = ("a/inner.rs", "pub struct Thing; impl super::Promise for Thing {}");
    let parent = |text: &'static str| [("lib.rs", "pub mod a;"), ("a/mod.rs", text), child];
    assert!(loop_sizes(&parent("mod inner; pub trait Promise {} pub use inner::Thing;")).is_empty());
    assert_eq!(loop_sizes(&parent("mod inner; pub trait Promise {} enum All { One(inner::Thing) }")), [2]);
    let both = tiny(&[("nelu3d", &parent("mod inner; pub trait Promise {} enum All { One(inner::Thing) }"))]);
    assert!(both.loops(&["crates/nelu3d/src/a"]).is_empty());
}

#[test]
fn a_loop_is_shown_file_by_file() {
    let files =
        [("lib.rs", "mod a; mod b;"), ("a.rs", "pub struct A(crate::b::B);"), ("b.rs", "pub type B = crate::a::A;")];
    let text = tiny(&[("nelu3d", &files)]).loops(&[]).concat();
    assert!(text.contains("crates/nelu3d/src/a.rs names crate::b::B\n    of crates/nelu3d/src/b.rs"), "{text}");
    assert!(text.contains("crates/nelu3d/src/b.rs names crate::a::A\n    of crates/nelu3d/src/a.rs"), "{text}");
}

#[test]
fn crates_and_layers_are_held() {
    let method = [
        ("lib.rs", "pub mod color_field; pub mod sequence; pub mod from_projector; pub mod noise;"),
        ("color_field.rs", "pub struct Field; use crate::sequence::Sequence;"),
        (
            "sequence/mod.rs",
            "pub struct Sequence; use crate::color_field::Field; use crate::from_projector::Projector;",
        ),
        ("from_projector.rs", "pub struct Projector; use nelu3d_sim::Scene;"),
        ("noise.rs", "use nelu3d_scan::Image;"),
    ];
    let all = tiny(&[
        ("nelu3d", &method),
        ("nelu3d-sim", &[("lib.rs", "pub struct Scene(nelu3d_scan::Image, nelu3d::color_field::Field);")]),
        ("nelu3d-scan", &[("lib.rs", "pub struct Image;")]),
        ("nelu3d-core", &[("lib.rs", "")]),
    ]);
    let wrong = all.against_crates();
    assert_eq!(wrong.len(), 2, "{wrong:?}");
    assert!(wrong[0].contains("nelu3d-core") && wrong[1].contains("from_projector.rs names nelu3d_sim::Scene"));
    let wrong = all.against_layers();
    assert_eq!(wrong.len(), 3, "{wrong:?}");
    assert!(wrong[0].contains("noise.rs is in no layer"));
    assert!(wrong[1].contains("color_field.rs names crate::sequence::Sequence"));
    assert!(wrong[2].contains("sequence/mod.rs names crate::from_projector::Projector"));
}
