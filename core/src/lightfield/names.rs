//! Which picture of a folder is which view, by the numbers in their names.
//!
//! A number may have a sign (`view_-3_2`) and, with three digits or more, a fraction (`out_00_16_-859.604919`). Numbers
//! that are the same in all names are ignored. The last two whole numbers that name every place of a grid are row and
//! column, whatever their first value; a single number counts row by row. Places of the grid without a picture are
//! absent views.

use std::collections::{BTreeMap, BTreeSet};

use super::meta::MAX_VIEWS;

/// Places of a grid for each picture, above which numbers do not make a grid: a cross and its diagonals, and more.
/// Source: chosen.
const SPARSE: usize = 8;
/// Digits of a fraction, so that `view1.2` is row 1, column 2.
/// Source: chosen.
const FRACTION: usize = 3;
/// Names in messages.
const FEW: usize = 4;

/// What is known of the order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    /// Row and column are in the names.
    Named,
    /// One running number whose grid follows from their count.
    Counted,
    /// One running number, its grid as the user says.
    Stated,
}

/// A grid of views.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Arrangement {
    pub(super) views: [usize; 2],
    /// Row by row; `None` where a view is absent.
    pub(super) names: Vec<Option<String>>,
    /// Pictures that are no views.
    pub(super) left_out: Vec<String>,
    pub(super) order: Order,
}

impl Arrangement {
    /// The places without a picture, row by row.
    pub(super) fn missing(&self) -> Vec<usize> {
        (0..self.names.len()).filter(|&k| self.names[k].is_none()).collect()
    }

    /// A sentence on the pictures that are no views.
    pub(super) fn left_out_note(&self) -> Option<String> {
        let first: Vec<&str> = self.left_out.iter().take(FEW).map(String::as_str).collect();
        let more = if self.left_out.len() > FEW { ", …" } else { "" };
        let n = self.left_out.len();
        (n > 0)
            .then(|| format!("{n} pictures are no views by their names and are left out: {}{more}", first.join(", ")))
    }
}

/// A number in a name, in units of 10⁻⁹; whether it is whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Number {
    nano: i128,
    whole: bool,
}

/// A name's numbers, and the name with each of them replaced by `#`. `None` if a number is too long to be one.
fn split_numbers(name: &str) -> Option<(String, Vec<Number>)> {
    let (mut pattern, mut numbers) = (String::new(), Vec::new());
    let bytes = name.as_bytes();
    let digits_from = |k: usize| bytes[k..].iter().take_while(|b| b.is_ascii_digit()).count();
    let mut k = 0;
    while k < bytes.len() {
        // A sign belongs to the number when no letter or digit stands before it.
        let signed = matches!(bytes[k], b'-' | b'+')
            && digits_from(k + 1) > 0
            && !pattern.ends_with('#')
            && !pattern.chars().last().is_some_and(char::is_alphanumeric);
        let start = k + usize::from(signed);
        let n = digits_from(start);
        if n == 0 {
            let c = name[k..].chars().next()?;
            pattern.push(c);
            k += c.len_utf8();
            continue;
        }
        let mut nano = i128::from(name[start..start + n].parse::<u64>().ok()?) * 1_000_000_000;
        let mut end = start + n;
        let fraction = if bytes.get(end) == Some(&b'.') { digits_from(end + 1) } else { 0 };
        if fraction >= FRACTION {
            let text: String = name[end + 1..end + 1 + fraction].chars().chain("000000000".chars()).take(9).collect();
            nano += text.parse::<i128>().ok()?;
            end += 1 + fraction;
        }
        let whole = fraction < FRACTION;
        numbers.push(Number { nano: if signed && bytes[k] == b'-' { -nano } else { nano }, whole });
        pattern.push('#');
        k = end;
    }
    Some((pattern, numbers))
}

type Named = (Vec<Number>, String);

/// Finds which picture is which view.
pub(super) fn arrange_names(names: Vec<String>, wanted: Option<[usize; 2]>) -> Result<Arrangement, String> {
    let mut groups: BTreeMap<String, Vec<Named>> = BTreeMap::new();
    let mut left_out = Vec::new();
    for name in names {
        match split_numbers(&name) {
            Some((pattern, numbers)) => groups.entry(pattern).or_default().push((numbers, name)),
            None => left_out.push(name),
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
    let pattern = largest.first().map_or_else(String::new, |p| (*p).clone());
    let mut group = groups.remove(&pattern).unwrap_or_default();
    left_out.extend(groups.into_values().flatten().map(|(_, name)| name));
    left_out.sort();
    group.sort();
    let count = group.first().map_or(0, |(numbers, _)| numbers.len());
    let distinct: Vec<BTreeSet<Number>> =
        (0..count).map(|i| group.iter().map(|(numbers, _)| numbers[i]).collect()).collect();
    let varying: Vec<usize> = (0..count).filter(|&i| distinct[i].len() > 1).collect();
    let whole: Vec<usize> = varying.iter().copied().filter(|&i| distinct[i].iter().all(|n| n.whole)).collect();
    // Whole numbers before fractions, the last pair first; full grids before those with gaps.
    for candidates in [&whole, &varying] {
        for full in [true, false] {
            for (b, &j) in candidates.iter().enumerate().rev() {
                for &i in candidates[..b].iter().rev() {
                    let Some((views, names)) = grid_of(&group, [i, j], [&distinct[i], &distinct[j]], full) else {
                        continue;
                    };
                    if wanted.is_some_and(|w| w != views) {
                        let [r, c] = views;
                        return Err(format!("the names {pattern} give {r}x{c} views, not those of --views"));
                    }
                    return Ok(Arrangement { views, names, left_out, order: Order::Named });
                }
            }
        }
    }
    match varying[..] {
        [] | [_] => running(&pattern, group, varying.first().copied(), wanted, left_out),
        _ => Err(describe_repetition(&pattern, &varying, &group)),
    }
}

/// The sides and places of the grid that two numbers make; with `full`, only where every place has its picture.
fn grid_of(
    group: &[Named],
    [i, j]: [usize; 2],
    [rows, columns]: [&BTreeSet<Number>; 2],
    full: bool,
) -> Option<([usize; 2], Vec<Option<String>>)> {
    let (row_of, column_of) = (Scale::of(rows)?, Scale::of(columns)?);
    let views = [row_of.count, column_of.count];
    let places = views[0].checked_mul(views[1])?;
    if places > SPARSE * group.len() || views.iter().any(|&n| n > MAX_VIEWS) || (full && places != group.len()) {
        return None;
    }
    let mut names = vec![None; places];
    for (numbers, name) in group {
        let at = row_of.place(numbers[i]) * views[1] + column_of.place(numbers[j]);
        // Two pictures of one place: another number tells them apart.
        if names[at].replace(name.clone()).is_some() {
            return None;
        }
    }
    Some((views, names))
}

/// Evenly spaced numbers.
struct Scale {
    first: i128,
    step: i128,
    count: usize,
}

impl Scale {
    /// From the first to the last of `numbers`, with the largest step that meets them all.
    fn of(numbers: &BTreeSet<Number>) -> Option<Scale> {
        let first = numbers.first()?.nano;
        let step = numbers.iter().fold(0, |step, n| common_divisor(step, n.nano - first));
        let count = if step == 0 { 1 } else { usize::try_from((numbers.last()?.nano - first) / step).ok()? + 1 };
        Some(Scale { first, step, count })
    }

    fn place(&self, number: Number) -> usize {
        if self.step == 0 { 0 } else { ((number.nano - self.first) / self.step) as usize }
    }
}

fn common_divisor(a: i128, b: i128) -> i128 {
    if b == 0 { a } else { common_divisor(b, a % b) }
}

/// Pictures with one running number, or a single one.
fn running(
    pattern: &str,
    group: Vec<Named>,
    number: Option<usize>,
    wanted: Option<[usize; 2]>,
    left_out: Vec<String>,
) -> Result<Arrangement, String> {
    let n = group.len();
    let Some(i) = number else {
        let names = group.into_iter().map(|(_, name)| Some(name)).collect();
        return match wanted {
            Some([rows, columns]) if rows * columns != n => {
                Err(format!("{n} pictures {pattern}, not {rows}x{columns}"))
            }
            _ => Ok(Arrangement { views: [1, 1], names, left_out, order: Order::Named }),
        };
    };
    let values: BTreeSet<Number> = group.iter().map(|(numbers, _)| numbers[i]).collect();
    let Some(scale) = Scale::of(&values).filter(|s| values.len() == n && s.count <= MAX_VIEWS * MAX_VIEWS) else {
        return Err(format!("the {n} names {pattern} do not contain row and column, nor one running number"));
    };
    let unit = 1_000_000_000;
    let (from, to) = (scale.first / unit, (scale.first + scale.step * (scale.count as i128 - 1)) / unit);
    // Numbers that begin with 0 or 1 count from there; of others the first view may be absent.
    let with_gaps = scale.count > n;
    let square = |n: usize| (n.isqrt() * n.isqrt() == n).then(|| [n.isqrt(); 2]);
    let (views, order) = match wanted {
        Some([rows, columns]) if rows * columns == n && !with_gaps => ([rows, columns], Order::Stated),
        Some([rows, columns]) if rows * columns > n && scale.count <= rows * columns && from <= 1 => {
            ([rows, columns], Order::Stated)
        }
        Some([rows, columns]) => {
            let gaps = if with_gaps { " with gaps, which are not row by row of such a grid" } else { "" };
            return Err(format!("{n} pictures {pattern} numbered {from} to {to}{gaps}, not {rows}x{columns} views"));
        }
        None => match square(scale.count) {
            Some(views) => (views, Order::Counted),
            None if with_gaps => {
                return Err(format!(
                    "{n} pictures {pattern} numbered {from} to {to} with gaps: views are missing; --views ROWSxCOLUMNS \
                     says how many there would be"
                ));
            }
            None => {
                return Err(format!(
                    "{n} pictures {pattern} are no square of views: --views ROWSxCOLUMNS says how they are arranged, row \
                     by row, and of how many some are missing"
                ));
            }
        },
    };
    let mut names = vec![None; views[0] * views[1]];
    for (numbers, name) in group {
        if let Some(place) = names.get_mut(scale.place(numbers[i])) {
            *place = Some(name);
        }
    }
    Ok(Arrangement { views, names, left_out, order })
}

/// Why several numbers in the names give no grid.
fn describe_repetition(pattern: &str, varying: &[usize], group: &[Named]) -> String {
    let [.., i, j] = *varying else { return format!("the names {pattern} do not contain row and column") };
    let there: BTreeSet<(Number, Number)> = group.iter().map(|(n, _)| (n[i], n[j])).collect();
    if there.len() < group.len() {
        return format!("the names {pattern} give some views twice");
    }
    format!("the names {pattern} give no grid of views: most places of row and column are missing")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arranged(
        names: impl IntoIterator<Item = String>,
        wanted: Option<[usize; 2]>,
    ) -> Result<([usize; 2], Vec<String>, usize), String> {
        // Reversed, to test that the order of a listing does not matter.
        let mut names: Vec<String> = names.into_iter().collect();
        names.reverse();
        let found = arrange_names(names, wanted)?;
        let missing = found.missing();
        Ok((found.views, found.names.into_iter().flatten().collect(), missing.len()))
    }

    #[test]
    fn one_running_number() {
        let names: Vec<String> = (0..81).map(|i| format!("input_Cam{i:03}.png")).collect();
        assert_eq!(arranged(names.clone(), None).unwrap(), ([9, 9], names, 0));
        let names = || (5..11).map(|i| format!("{i}.PNG"));
        assert_eq!(arranged(names(), Some([2, 3])).unwrap().0, [2, 3]);
        assert!(arranged(names(), None).unwrap_err().contains("no square"));
        // By number, not by letters.
        assert_eq!(arranged((8..12).map(|i| format!("{i}.png")), None).unwrap().1[3], "11.png");
    }

    #[test]
    fn a_running_number_with_gaps_is_a_grid_with_absent_views() {
        let cross = |i: &usize| {
            let (r, c) = (i / 9, i % 9);
            r == 4 || c == 4 || r == c || r + c == 8
        };
        let names = || (0..81).filter(cross).map(|i| format!("input_Cam{i:03}.png"));
        let (views, there, missing) = arranged(names(), None).unwrap();
        assert_eq!((views, there.len(), missing), ([9, 9], 33, 48));
        assert!(arranged(names(), Some([3, 11])).unwrap_err().contains("gaps"));
        let first = || (0..64).map(|i| format!("input_Cam{i:03}.png"));
        assert_eq!(arranged(first(), Some([9, 9])).unwrap().2, 17);
        let odd = (0..80).filter(|i| i % 7 != 3).map(|i| format!("{i}.png"));
        assert!(arranged(odd, None).unwrap_err().contains("gaps"));
    }

    #[test]
    fn row_and_column_from_any_start() {
        for start in [0, 1, 4] {
            let names: Vec<String> =
                (0..3).flat_map(|r| (0..12).map(move |c| format!("view_{}_{}.png", r + start, c + start))).collect();
            assert_eq!(arranged(names.clone(), None).unwrap(), ([3, 12], names, 0));
        }
    }

    #[test]
    fn signs_and_fractions() {
        let names: Vec<String> = (-3..4).flat_map(|r| (-3..4).map(move |c| format!("view_{r}_{c}.png"))).collect();
        assert_eq!(arranged(names.clone(), None).unwrap(), ([7, 7], names, 0));
        // Rows count upwards, the camera's height falls and wavers.
        let names: Vec<String> = (0..5)
            .flat_map(|r| (0..6).map(move |c| (r, c)))
            .map(|(r, c)| {
                let (x, y) = (8.1 * f64::from(c) - 20.0 + 0.01 * f64::from(r), 20.0 - 8.4 * f64::from(r));
                format!("out_{r:02}_{c:02}_{y:.6}_{x:.6}_.png")
            })
            .collect();
        assert_eq!(arranged(names.clone(), None).unwrap(), ([5, 6], names, 0));
        // A hyphen between letters or numbers is no sign.
        let names: Vec<String> = (0..3).flat_map(|r| (0..3).map(move |c| format!("img-{r}-{c}.png"))).collect();
        assert_eq!(arranged(names.clone(), None).unwrap(), ([3, 3], names, 0));
        let names: Vec<String> = (0..3).flat_map(|r| (0..3).map(move |c| format!("v{r}.{c}.png"))).collect();
        assert_eq!(arranged(names.clone(), None).unwrap(), ([3, 3], names, 0));
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
        assert_eq!(arranged(names, None).unwrap(), ([4, 4], expected, 0));
    }

    #[test]
    fn other_pictures_beside_the_views_are_counted() {
        let mut names: Vec<String> = (0..4).map(|i| format!("view{i}.png")).collect();
        names.extend(["disparity.png".to_string(), "center_7.png".into()]);
        let found = arrange_names(names, None).unwrap();
        assert_eq!((found.views, found.left_out.len()), ([2, 2], 2));
        assert!(found.left_out_note().unwrap().contains("disparity.png"));
        let two = ["a_1.png", "a_2.png", "b_1.png", "b_2.png"].map(String::from).to_vec();
        assert!(arrange_names(two, None).unwrap_err().contains("as many"));
    }

    #[test]
    fn a_gap_is_named() {
        let mut names: Vec<String> = (0..3).flat_map(|r| (0..3).map(move |c| format!("v{r}_{c}.png"))).collect();
        names.remove(5);
        let found = arrange_names(names, None).unwrap();
        assert_eq!((found.views, found.missing()), ([3, 3], vec![5]));
        // A row that is wholly absent.
        let names = [0, 1, 3, 4].into_iter().flat_map(|r| (0..5).map(move |c| format!("v{r}_{c}.png")));
        assert_eq!(arranged(names, None).map(|(views, _, missing)| (views, missing)).unwrap(), ([5, 5], 5));
        assert!(arrange_names(vec![], None).is_err());
        assert!(arrange_names(vec![format!("{}.png", "9".repeat(30))], None).is_err());
        assert_eq!(arrange_names(vec!["only.png".into()], None).unwrap().views, [1, 1]);
    }
}
