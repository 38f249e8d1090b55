//! Folders of numbered pictures, one per view, as other tools leave them: `view_3_5.png`, `input_Cam042.png`,
//! `IMG_0001_017_02_04.png` and the like.
//!
//! Numbers that are the same in all names are ignored. The last two numbers that together name every place of a full
//! grid exactly once are row and column, whatever their first value; a single number counts row by row.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use ndarray::Array3;

use super::colour::ColourSpace;
use super::error::{Error, io_at, malformed};
use super::format::ReadOptions;
use super::image_file;
use super::meta::Meta;
use super::view_io::ViewSource;

/// Most files looked at in a folder.
/// Source: chosen.
const MAX_FILES: usize = 1 << 17;
/// Endings of pictures.
const EXTENSIONS: [&str; 8] = ["png", "jpg", "jpeg", "tif", "tiff", "ppm", "pgm", "pnm"];

/// Reads a folder of numbered pictures.
pub(super) struct Reader {
    folder: PathBuf,
    /// Row-major.
    names: Vec<String>,
    meta: Meta,
}

impl Reader {
    pub(super) fn open(folder: &Path, options: &ReadOptions) -> Result<Self, Error> {
        let mut names = Vec::new();
        for entry in std::fs::read_dir(folder).map_err(io_at(folder))?.take(MAX_FILES) {
            let entry = entry.map_err(io_at(folder))?;
            // Names that are not text have no numbers; other files do not matter.
            if let Some(name) = entry.file_name().to_str()
                && is_picture_name(name)
            {
                names.push(name.to_string());
            }
        }
        let (views, names) = arrange_names(names, options.views).map_err(|reason| malformed(folder, reason))?;
        let Some(first) = names.first() else { return Err(malformed(folder, "no pictures")) };
        let image_file::Shape { width, height, channels } = image_file::read_shape(&folder.join(first))?;
        let meta = Meta::new(views, [height, width], channels, options.colour.unwrap_or(ColourSpace::Srgb));
        meta.check().map_err(|e| malformed(folder, e.to_string()))?;
        Ok(Reader { folder: folder.to_path_buf(), names, meta })
    }
}

impl ViewSource for Reader {
    fn meta(&self) -> &Meta {
        &self.meta
    }

    fn read(&self, v: usize, u: usize) -> Result<Array3<f32>, Error> {
        self.meta.check_place(v, u)?;
        image_file::read_view(&self.folder.join(&self.names[v * self.meta.views[1] + u]), &self.meta)
    }
}

fn is_picture_name(name: &str) -> bool {
    let Some((stem, extension)) = name.rsplit_once('.') else { return false };
    !stem.is_empty() && !stem.starts_with('.') && EXTENSIONS.iter().any(|e| extension.eq_ignore_ascii_case(e))
}

/// A name's numbers, and the name with each of them replaced by `#`. `None` if a number is too long to be one.
fn split_numbers(name: &str) -> Option<(String, Vec<u64>)> {
    let mut pattern = String::new();
    let mut numbers = Vec::new();
    let mut rest = name;
    while let Some(start) = rest.find(|c: char| c.is_ascii_digit()) {
        let digits = rest[start..].find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len() - start);
        pattern.push_str(&rest[..start]);
        pattern.push('#');
        numbers.push(rest[start..start + digits].parse().ok()?);
        rest = &rest[start + digits..];
    }
    pattern.push_str(rest);
    Some((pattern, numbers))
}

/// Finds which picture is which view: the arrangement (rows, columns) and the names in row-major order.
fn arrange_names(names: Vec<String>, wanted: Option<[usize; 2]>) -> Result<([usize; 2], Vec<String>), String> {
    let mut groups: BTreeMap<String, Vec<(Vec<u64>, String)>> = BTreeMap::new();
    for name in names {
        if let Some((pattern, numbers)) = split_numbers(&name) {
            groups.entry(pattern).or_default().push((numbers, name));
        }
    }
    let most = groups.values().map(Vec::len).max().unwrap_or(0);
    if most == 0 {
        return Err("neither a lightfield.json nor numbered pictures in this folder".into());
    }
    let largest: Vec<&String> = groups.iter().filter(|(_, g)| g.len() == most).map(|(p, _)| p).collect();
    if let [first, second, ..] = largest[..] {
        return Err(format!("there are as many pictures named {first} as {second}: put the views alone into a folder"));
    }
    let Some((pattern, mut group)) = groups.into_iter().find(|(_, g)| g.len() == most) else {
        return Err("no pictures".into());
    };
    group.sort();
    let columns = group[0].0.len();
    let distinct: Vec<BTreeSet<u64>> =
        (0..columns).map(|i| group.iter().map(|(numbers, _)| numbers[i]).collect()).collect();
    let varying: Vec<usize> = (0..columns).filter(|&i| distinct[i].len() > 1).collect();

    // Two numbers that together name a full grid, the last ones first.
    for (b, &j) in varying.iter().enumerate().rev() {
        for &i in varying[..b].iter().rev() {
            let grid = [distinct[i].len(), distinct[j].len()];
            let places: BTreeMap<(u64, u64), &String> = group.iter().map(|(n, name)| ((n[i], n[j]), name)).collect();
            if grid[0] * grid[1] == group.len() && places.len() == group.len() {
                if wanted.is_some_and(|w| w != grid) {
                    return Err(format!(
                        "the names {pattern} give {}x{} views, not those of --views",
                        grid[0], grid[1]
                    ));
                }
                return Ok((grid, places.into_values().cloned().collect()));
            }
        }
    }
    let n = group.len();
    let side = n.isqrt();
    let views = match (varying.len(), wanted) {
        (0, None) => [1, 1],
        (1, None) if side * side == n => [side, side],
        (0 | 1, Some([rows, columns])) if rows.checked_mul(columns) == Some(n) => [rows, columns],
        (0 | 1, Some([rows, columns])) => return Err(format!("{n} pictures {pattern}, not {rows}x{columns}")),
        (1, None) => {
            return Err(format!(
                "{n} pictures {pattern} are no square: give --views ROWSxCOLUMNS, or add what is missing"
            ));
        }
        _ => return Err(describe_gap(&pattern, &distinct, &varying, &group)),
    };
    Ok((views, group.into_iter().map(|(_, name)| name).collect()))
}

/// Why several numbers in the names give no full grid; the last two are read as row and column.
fn describe_gap(pattern: &str, distinct: &[BTreeSet<u64>], varying: &[usize], group: &[(Vec<u64>, String)]) -> String {
    let [.., i, j] = *varying else { return format!("the names {pattern} do not contain row and column") };
    let there: BTreeSet<(u64, u64)> = group.iter().map(|(n, _)| (n[i], n[j])).collect();
    // Stops at the first gap, so at most one step more than there are files.
    let gap = distinct[i].iter().flat_map(|&r| distinct[j].iter().map(move |&c| (r, c))).find(|p| !there.contains(p));
    match gap {
        Some((row, column)) => {
            format!("the names {pattern} give no full grid of views: row {row}, column {column} is missing")
        }
        None => format!("the names {pattern} give some views twice"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(names: impl IntoIterator<Item = String>) -> Vec<String> {
        // Reversed, to test that the order of a listing does not matter.
        let mut names: Vec<String> = names.into_iter().collect();
        names.reverse();
        names
    }

    #[test]
    fn one_running_number() {
        let names: Vec<String> = (0..81).map(|i| format!("input_Cam{i:03}.png")).collect();
        let (views, order) = arrange_names(named(names.clone()), None).unwrap();
        assert_eq!((views, order), ([9, 9], names));
        let names = (5..11).map(|i| format!("{i}.PNG"));
        assert_eq!(arrange_names(named(names.clone()), Some([2, 3])).unwrap().0, [2, 3]);
        assert!(arrange_names(named(names), None).unwrap_err().contains("no square"));
        // By number, not by letters.
        assert_eq!(arrange_names(named((8..12).map(|i| format!("{i}.png"))), None).unwrap().1[3], "11.png");
    }

    #[test]
    fn row_and_column_from_any_start() {
        for start in [0, 1, 4] {
            let names: Vec<String> =
                (0..3).flat_map(|r| (0..12).map(move |c| format!("view_{}_{}.png", r + start, c + start))).collect();
            assert_eq!(arrange_names(named(names.clone()), None).unwrap(), ([3, 12], names));
        }
    }

    #[test]
    fn a_running_number_beside_row_and_column_in_serpentine_order() {
        let mut names = Vec::new();
        let mut expected = vec![String::new(); 16];
        for i in 0..16 {
            let (row, step) = (i / 4, i % 4);
            let column = if row % 2 == 0 { step } else { 3 - step };
            let name = format!("IMG_0001_{:03}_{:02}_{:02}.png", i + 1, row + 1, column + 1);
            expected[row * 4 + column] = name.clone();
            names.push(name);
        }
        assert_eq!(arrange_names(named(names), None).unwrap(), ([4, 4], expected));
    }

    #[test]
    fn other_pictures_beside_the_views_do_not_matter() {
        let mut names: Vec<String> = (0..4).map(|i| format!("view{i}.png")).collect();
        names.extend(["disparity.png".to_string(), "center_7.png".into()]);
        assert_eq!(arrange_names(names, None).unwrap().0, [2, 2]);
        let two = ["a_1.png", "a_2.png", "b_1.png", "b_2.png"].map(String::from).to_vec();
        assert!(arrange_names(two, None).unwrap_err().contains("as many"));
    }

    #[test]
    fn a_gap_is_named() {
        let mut names: Vec<String> = (0..3).flat_map(|r| (0..3).map(move |c| format!("v{r}_{c}.png"))).collect();
        names.remove(5);
        assert!(arrange_names(names, None).unwrap_err().contains("row 1, column 2 is missing"));
        assert!(arrange_names(vec![], None).is_err());
        assert!(arrange_names(vec![format!("{}.png", "9".repeat(30))], None).is_err());
        assert_eq!(arrange_names(vec!["only.png".into()], None).unwrap().0, [1, 1]);
    }
}
