//! The ramps in the tree, before the model is read from it: what an axis' ramp has from the set's, which keys go with which
//! profile, and the files of tables. Places stay true, also those in files. It knows no numbers.

use std::fs::File;
use std::io::Read;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use miette::NamedSource;
use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use crate::document::Segment;
use crate::fault::Fault;
use crate::load::printable;
use crate::problem::Problem;
use crate::{Config, KeyPath, Profile, ProfileName};

/// Keys that any ramp may have from the set's. The interval of an emergency stop belongs to the interval of the ramp.
const OF_EVERY_PROFILE: [&str; 3] = ["offset", "short_moves", "differences"];
/// 233 numbers and long comments have room in this; what is longer is no table.
const LONGEST_FILE: u64 = 256 * 1024;

/// A table of counts that was read from a file: where each of them stands.
pub(crate) struct TableFile {
    /// `counts` of the ramp that has it.
    key: KeyPath,
    text: NamedSource<Arc<str>>,
    counts: Vec<u16>,
    /// Where each count stands.
    spans: Vec<Range<usize>>,
}

impl TableFile {
    /// The text and the place in it that `key` names, if it is one of this table.
    pub(crate) fn place(&self, key: &KeyPath) -> Option<(&NamedSource<Arc<str>>, Range<usize>)> {
        match key.segments().strip_prefix(self.key.segments())? {
            // What is wrong with a table as a whole shows at its end, or where it is too long.
            [] => {
                let end = self.text.inner().trim_end().len();
                Some((&self.text, self.spans.get(crate::SPEEDS).cloned().unwrap_or(end..end)))
            }
            [Segment::Index(index)] => Some((&self.text, self.spans.get(*index)?.clone())),
            _ => None,
        }
    }
}

/// Gives the ramps of `config` the tables that were read for them.
pub(crate) fn fill(config: &mut Config, files: &[TableFile]) {
    let root = KeyPath::default();
    let axes = root.key("axis");
    let of_axes = config.axes.iter_mut().enumerate();
    let of_axes =
        of_axes.filter_map(|(index, axis)| Some((axes.index(index).key("ramp"), axis.ramp.as_mut()?)));
    for (key, ramp) in std::iter::once((root.key("ramp"), &mut config.ramp)).chain(of_axes) {
        let key = key.key("counts");
        if let (Some(file), Profile::Table(table)) =
            (files.iter().find(|file| file.key == key), &mut ramp.profile)
        {
            table.counts.clone_from(&file.counts);
        }
    }
}

/// Completes and checks every ramp of the tree, and reads the tables that are in files, which are looked for in `folder`.
pub(crate) fn prepare(
    root: &mut Spanned<DeValue<'_>>,
    folder: Option<&Path>,
    text: &impl Fn() -> NamedSource<Arc<str>>,
) -> Result<Vec<TableFile>, Box<Fault>> {
    let DeValue::Table(root) = root.get_mut() else {
        return Ok(vec![]);
    };
    let set_ramp = root.get("ramp").and_then(|ramp| ramp.get_ref().as_table()).cloned();
    let mut files = Vec::new();
    if let Some(ramp) = root.get_mut("ramp") {
        prepare_one(&KeyPath::default().key("ramp"), ramp, folder, text, &mut files)?;
    }
    let of_axes = KeyPath::default().key("axis");
    let Some(DeValue::Array(elements)) = root.get_mut("axis").map(Spanned::get_mut) else {
        return Ok(files);
    };
    for (index, element) in elements.iter_mut().enumerate() {
        let DeValue::Table(axis) = element.get_mut() else { continue };
        let Some(ramp) = axis.get_mut("ramp") else { continue };
        if let (DeValue::Table(own), Some(set_ramp)) = (ramp.get_mut(), &set_ramp) {
            inherit(own, set_ramp);
        }
        prepare_one(&of_axes.index(index).key("ramp"), ramp, folder, text, &mut files)?;
    }
    Ok(files)
}

fn prepare_one(
    key: &KeyPath,
    ramp: &mut Spanned<DeValue<'_>>,
    folder: Option<&Path>,
    text: &impl Fn() -> NamedSource<Arc<str>>,
    files: &mut Vec<TableFile>,
) -> Result<(), Box<Fault>> {
    let DeValue::Table(ramp) = ramp.get_mut() else {
        return Ok(());
    };
    let Some(profile) = profile_of(ramp) else {
        return Ok(());
    };
    let at = |name: &str, span: Range<usize>, other: Option<Range<usize>>, problem| {
        Box::new(Fault::new(&text(), key.key(name), &span, other.as_ref(), problem))
    };
    for (name, _) in ramp.iter() {
        let word = name.get_ref().as_ref();
        let owner = ProfileName::ALL.into_iter().find(|owner| owner.keys().contains(&word));
        if let Some(owner) = owner.filter(|_| !profile.keys().contains(&word)) {
            let written = ramp.get("profile").map(Spanned::span);
            let problem = Problem::OtherProfile { key: word.to_owned(), owner, profile };
            return Err(at(word, name.span(), written, problem));
        }
    }
    let Some(file) = ramp.get("file") else {
        return Ok(());
    };
    let span = file.span();
    // A file that is no string is the model's to refuse.
    let Some(name) = file.get_ref().as_str() else {
        return Ok(());
    };
    if let Some(counts) = ramp.get("counts") {
        return Err(at("file", span, Some(counts.span()), Problem::TwoTables));
    }
    let Some(folder) = folder else {
        return Err(at("file", span, None, Problem::NoFolder));
    };
    let path = folder.join(name);
    let unreadable = |reason| Problem::TableUnreadable { path: path.clone(), reason };
    let content = read(&path).map_err(|reason| at("file", span.clone(), None, unreadable(reason)))?;
    let table = parse(&path, &content, key.key("counts"))?;
    // The numbers follow when there is a model to take them.
    ramp.remove("file");
    let none = DeValue::Array(DeArray::default());
    ramp.insert(Spanned::new(span.clone(), "counts".into()), Spanned::new(span, none));
    files.push(table);
    Ok(())
}

/// The profile of a ramp; `None` if its word is none, which the model refuses.
fn profile_of(ramp: &DeTable<'_>) -> Option<ProfileName> {
    match ramp.get("profile") {
        None => Some(ProfileName::default()),
        Some(word) => ProfileName::of(word.get_ref().as_str()?),
    }
}

/// Gives an axis' own ramp what it leaves out of the set's: all if it has the same profile.
fn inherit<'i>(own: &mut DeTable<'i>, set: &DeTable<'i>) {
    if !own.contains_key("profile")
        && let Some((name, profile)) = set.get_key_value("profile")
    {
        own.insert(name.clone(), profile.clone());
    }
    let same = profile_of(own) == profile_of(set);
    let has_table = own.contains_key("file") || own.contains_key("counts");
    for (key, value) in set {
        let name = key.get_ref().as_ref();
        let wanted = if same {
            !(has_table && matches!(name, "file" | "counts"))
        } else {
            OF_EVERY_PROFILE.contains(&name)
        };
        if wanted && !own.contains_key(name) {
            own.insert(key.clone(), value.clone());
        }
    }
}

fn read(path: &Path) -> Result<String, String> {
    let mut bytes = Vec::new();
    let mut file = File::open(path).map_err(|error| error.to_string())?;
    file.by_ref().take(LONGEST_FILE + 1).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if bytes.len() as u64 > LONGEST_FILE {
        return Err("it is longer than 256 KiB".to_owned());
    }
    String::from_utf8(bytes).map_err(|_| "it is not UTF-8 text".to_owned())
}

/// Finds the counts: one whole number a line, comments after `#`, empty lines.
fn parse(path: &Path, content: &str, key: KeyPath) -> Result<TableFile, Box<Fault>> {
    let text = NamedSource::new(path.display().to_string(), Arc::from(printable(content)));
    let (mut counts, mut spans) = (Vec::new(), Vec::new());
    let mut start = 0;
    for line in content.split_inclusive('\n') {
        let words = line.split('#').next().unwrap_or_default();
        let word = words.trim_start_matches('\u{feff}').trim();
        if !word.is_empty() {
            let begin = start + words.find(word).unwrap_or_default();
            let span = begin..begin + word.len();
            let Ok(count) = word.parse() else {
                let problem = Problem::TableLine { found: printable(word) };
                return Err(Box::new(Fault::new(&text, key.index(spans.len()), &span, None, problem)));
            };
            counts.push(count);
            spans.push(span);
        }
        start += line.len();
    }
    Ok(TableFile { key, text, counts, spans })
}
