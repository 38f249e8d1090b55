//! Outputs put in place, dropped, replaced, and written by two at once.

use super::*;

const PAGE: [&[u8]; 2] = [b"<!DOCTYPE html>1\n", b"<!DOCTYPE html>2\n"];

fn count(folder: &Path) -> usize {
    fs::read_dir(folder).unwrap().count()
}

/// An output folder with one file of these bytes.
fn put(path: &Path, bytes: &[u8], force: bool) -> Result<(), Error> {
    let pending = Pending::directory(path, force)?;
    write_part(&pending.path().join("deep/x"), bytes).unwrap();
    pending.commit()
}

#[test]
fn a_dropped_output_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let pending = Pending::directory(&dir.path().join("out"), false).unwrap();
    write_part(&pending.path().join("deep/x"), b"1").unwrap();
    let inner = Pending::directory(&pending.path().join("inner"), false).unwrap();
    write_part(&inner.path().join("y"), b"1").unwrap();
    drop(inner);
    drop(pending);
    drop(Pending::file(&dir.path().join("file"), false).unwrap());
    assert_eq!(count(dir.path()), 0);
}

#[test]
fn an_own_output_is_refused_or_replaced() {
    let dir = tempfile::tempdir().unwrap();
    let (file, folder) = (dir.path().join("file"), dir.path().join("folder"));
    write_file(&file, false, PAGE[0]).unwrap();
    assert!(matches!(write_file(&file, false, PAGE[1]), Err(Error::Exists(_))));
    write_file(&file, true, PAGE[1]).unwrap();
    assert!(fs::read(&file).unwrap().starts_with(PAGE[1]));
    put(&folder, b"1", false).unwrap();
    assert!(matches!(put(&folder, b"2", false), Err(Error::Exists(_))));
    put(&folder, b"2", true).unwrap();
    assert_eq!(fs::read(folder.join("deep/x")).unwrap(), b"2");
    // Neither in the place of the other.
    assert!(matches!(write_file(&folder, true, PAGE[0]), Err(Error::Kept { .. })));
    assert!(matches!(put(&file, b"3", true), Err(Error::Kept { .. })));
    assert_eq!(count(dir.path()), 2);
}

#[test]
fn what_is_added_while_it_is_written_is_kept() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("folder");
    put(&folder, b"1", false).unwrap();
    let pending = Pending::directory(&folder, true).unwrap();
    fs::write(folder.join("deep/mine"), "mine").unwrap();
    assert!(matches!(pending.commit(), Err(Error::Kept { .. })));
    assert_eq!(fs::read(folder.join("deep/mine")).unwrap(), b"mine");
    // In what is being written as well, which is then no longer whole.
    let pending = Pending::directory(&dir.path().join("other"), true).unwrap();
    let temporary = pending.path().to_path_buf();
    fs::write(temporary.join("mine"), "mine").unwrap();
    assert!(pending.commit().unwrap_err().to_string().contains("mine"));
    assert_eq!(fs::read(temporary.join("mine")).unwrap(), b"mine");
}

#[test]
fn two_writers_of_one_name_never_replace_each_other() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("file");
    let [one, other] = [Pending::file(&path, false).unwrap(), Pending::file(&path, false).unwrap()];
    one.write(PAGE[0]).unwrap();
    other.write(PAGE[1]).unwrap();
    one.commit().unwrap();
    assert!(matches!(other.commit(), Err(Error::Exists(_))));
    assert!(fs::read(&path).unwrap().starts_with(PAGE[0]));
    assert_eq!(count(dir.path()), 1);
}

#[test]
fn a_run_that_lives_is_not_swept() {
    let dir = tempfile::tempdir().unwrap();
    let pending = Pending::file(&dir.path().join("a"), false).unwrap();
    pending.write(PAGE[0]).unwrap();
    write_file(&dir.path().join("b"), false, PAGE[1]).unwrap();
    pending.commit().unwrap();
    assert_eq!(count(dir.path()), 2);
}

#[test]
fn a_folder_that_stepped_aside_gets_its_name_back() {
    let dir = tempfile::tempdir().unwrap();
    let [target, new] = ["out", "new"].map(|n| dir.path().join(n));
    put(&target, b"old", false).unwrap();
    put(&new, b"new", false).unwrap();
    step_aside(&new, &target).unwrap();
    assert_eq!(fs::read(target.join("deep/x")).unwrap(), b"new");
    assert_eq!(fs::read(new.join("deep/x")).unwrap(), b"old");
    assert_eq!(count(dir.path()), 2);
    // As a run that was killed between the two steps leaves it.
    let held = Temporary::new(dir.path(), true, false).unwrap();
    held.discard();
    let mut aside = held.path.clone().into_os_string();
    aside.push(ASIDE);
    drop(held);
    fs::rename(&new, &aside).unwrap();
    fs::rename(&target, dir.path().join("moved")).unwrap();
    sweep(dir.path());
    assert_eq!(fs::read(target.join("deep/x")).unwrap(), b"old");
}

#[test]
fn a_directory_exists_at_every_moment_of_its_replacement() {
    let dir = tempfile::tempdir().unwrap();
    let target = dir.path().join("out");
    let [a, b] = ["a", "b"].map(|n| dir.path().join(n));
    fs::create_dir(&a).unwrap();
    fs::create_dir(&b).unwrap();
    if let Err(e) = exchange(&a, &b) {
        println!("skipped: this file system cannot exchange two names ({e})");
        return;
    }
    put(&target, b"0", false).unwrap();
    let done = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        let watch = scope.spawn(|| {
            let mut looks = 0u32;
            while !done.load(std::sync::atomic::Ordering::Relaxed) {
                assert!(target.symlink_metadata().is_ok(), "absent at look {looks}");
                looks += 1;
            }
            looks
        });
        for n in 0..100u16 {
            put(&target, &n.to_le_bytes(), true).unwrap();
        }
        done.store(true, std::sync::atomic::Ordering::Relaxed);
        assert!(watch.join().unwrap() > 0);
    });
    assert_eq!(fs::read(target.join("deep/x")).unwrap(), 99u16.to_le_bytes());
}
