//! Limits of the machine: memory budget, many captures in one run, a full disk, folders that cannot be written or vanish.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

mod tiny;

use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use lenslet_test_support::{Skip, skip};
use tiny::{World, hashes, said, unfinished};

/// A figure of a running process, MiB.
fn memory(child: &Child, name: &str) -> Option<usize> {
    let text = fs::read_to_string(format!("/proc/{}/status", child.id())).ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix(name)?.strip_prefix(':').map(str::to_owned))?;
    line.split_whitespace().next()?.parse::<usize>().ok().map(|kib| kib / 1024)
}

/// Runs to the end; also the most memory it had, MiB. The system keeps that maximum, so that a late look misses nothing
/// but what came after it.
fn peak(mut command: Command) -> (std::process::Output, usize) {
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut most = 0;
    while child.try_wait().unwrap().is_none() {
        most = most.max(memory(&child, "VmHWM").unwrap_or(0));
        std::thread::sleep(Duration::from_millis(2));
    }
    (child.wait_with_output().unwrap(), most)
}

#[test]
fn a_memory_budget_holds() {
    let world = World::new();
    if !Path::new("/proc/self/status").exists() {
        return skip(Skip::Excused, "this system does not say how much memory a process has");
    }
    // Views of 800x960 pixels: some 50 MiB in all.
    let work = ["infer", "field.npy", "--out", "out/a.npy", "--scale", "16", "--dictionary", "small.lfd", "--fast"];
    let with = |scale: &'static str, mib: &'static str| {
        let mut all = work.to_vec();
        all[5] = scale;
        all.extend(["--memory", mib]);
        peak(world.command(&all))
    };
    let (output, most) = with("16", "2000");
    assert!(output.status.success(), "{}", said(&output));
    println!("{most} MiB of 2000");
    fs::remove_dir_all(world.at("out")).unwrap();
    let (output, most) = with("16", "24");
    println!("{most} MiB of 24");
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(said(&output).contains("--memory") && said(&output).lines().count() == 1, "{}", said(&output));
    assert!(most <= 24 + 64 + 32, "{most} MiB");
    assert!(!world.at("out/a.npy").exists());
    let output = world.run(&["info", "field.npy", "--memory", "3"]);
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
}

/// LENSLET_LOAD captures (default 24) in one run: memory stays where it was after the first eight.
#[test]
fn many_captures_in_one_run() {
    let world = World::new();
    let count = std::env::var("LENSLET_LOAD").ok().and_then(|n| n.parse().ok()).unwrap_or(24usize);
    fs::create_dir(world.at("many")).unwrap();
    for n in 0..count {
        fs::copy(world.at(&format!("shots/{}.lfp", n % 3 + 1)), world.at(&format!("many/{n:03}.lfp"))).unwrap();
    }
    // One thread, so that no two pieces of work fall together by chance.
    let work = [
        "decode",
        "many",
        "-c",
        "cam.calib",
        "--out",
        "out",
        "--size",
        "60",
        "--views",
        "3",
        "--json",
        "--threads",
        "1",
    ];
    let mut child = world.command(&work).stdout(Stdio::piped()).spawn().unwrap();
    let (mut early, mut late) = (0, 0);
    while child.try_wait().unwrap().is_none() {
        let done = fs::read_dir(world.at("out"))
            .map_or(0, |d| d.flatten().filter(|e| !e.file_name().to_string_lossy().contains(tiny::MARK)).count());
        // The maximum so far: read once eight are done, it covers all of them, however late this loop looks.
        late = memory(&child, "VmHWM").filter(|&now| now > 0).unwrap_or(late);
        if done >= 8 && early == 0 {
            early = late;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    let output = child.wait_with_output().unwrap();
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let seconds: Vec<f64> =
        report["decoded"].as_array().unwrap().iter().map(|d| d["seconds"]["total"].as_f64().unwrap()).collect();
    assert_eq!(seconds.len(), count);
    let mean = |s: &[f64]| s.iter().sum::<f64>() / s.len() as f64;
    let third = count / 3;
    println!(
        "{count} captures: {early} MiB within the first eight, {late} MiB after; {:.3} s each in the first third, {:.3} s \
         in the last",
        mean(&seconds[..third]),
        mean(&seconds[count - third..])
    );
    if !Path::new("/proc/self/status").exists() {
        return skip(Skip::Excused, "this system does not say how much memory a process has");
    }
    assert!(early > 0 && late <= early + 8, "memory grew from {early} to {late} MiB");
}

/// A file system in memory of its own, where this process may mount one.
struct Disk(PathBuf);

impl Disk {
    fn new(at: PathBuf, options: &str) -> Option<Disk> {
        fs::create_dir(&at).unwrap();
        let done = Command::new("mount").args(["-t", "tmpfs", "-o", options, "lenslet-test"]).arg(&at).output();
        if done.is_ok_and(|o| o.status.success()) {
            Some(Disk(at))
        } else {
            skip(Skip::Excused, "mounting a small disk is not allowed here");
            None
        }
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(&self.0).status();
    }
}

/// Failed with exit code 1 and one line that has these words.
fn failed(output: &std::process::Output, words: &[&str]) {
    let said = said(output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert_eq!(said.trim_end().lines().count(), 1, "{said}");
    for word in words {
        assert!(said.contains(word), "{word}: {said}");
    }
}

#[test]
fn a_full_disk_keeps_what_was_done() {
    let world = World::new();
    let Some(disk) = Disk::new(world.at("disk"), "size=600k") else { return };
    // One capture fits, two do not.
    let folder = ["decode", "shots", "-c", "cam.calib", "--out", "disk/out", "--size", "80", "--views", "3"];
    let output = world.run(&folder);
    failed(&output, &["decoded", "failed", ".lfp"]);
    assert!(!said(&output).starts_with("lenslet: 0 decoded"), "{}", said(&output));
    assert_eq!(unfinished(&disk.0), Vec::<PathBuf>::new());
    let kept = hashes(&world.at("disk/out/1"));
    assert_eq!(
        world
            .run(&["decode", "shots/1.lfp", "-c", "cam.calib", "--out", "all", "--size", "80", "--views", "3"])
            .status
            .code(),
        Some(0)
    );
    assert_eq!(kept, hashes(&world.at("all")));
    fs::remove_dir_all(disk.0.join("out")).unwrap();

    let full = "No space left";
    fs::write(disk.0.join("filler"), vec![1; 596 << 10]).unwrap();
    for work in [
        &["decode", "shots/1.lfp", "-c", "cam.calib", "--out", "disk/a", "--size", "80"][..],
        &["infer", "field.npy", "--out", "disk/a.npy", "--scale", "3", "--dictionary", "small.lfd", "--fast"],
        &["infer", "field.npy", "--out", "disk/a", "--scale", "3", "--dictionary", "small.lfd", "--fast"],
        &["calibrate", "white.lfp", "--out", "disk/a.calib"],
        &["train-dict", "photos", "--parameters", "train.json", "--out", "disk/a.lfd"],
        &["gen-pairs", "photos", "--out", "disk/a", "--pairs", "3000", "--crop", "96", "--shrink", "1"],
        &["simulate", "--sensor", "160", "--size", "160", "--views", "1", "--out", "disk/a"],
    ] {
        failed(&world.run(work), &[full, "disk/"]);
        // The log of training grows as it goes, and may hold its first epochs.
        let _ = fs::remove_file(disk.0.join("a.lfd.log.jsonl"));
        let left: Vec<String> = hashes(&disk.0).into_keys().filter(|name| name != "filler").collect();
        assert!(left.is_empty(), "{work:?} left {left:?}");
    }
}

#[test]
fn folders_that_cannot_be_written_and_files_that_cannot_be_read() {
    let world = World::new();
    fs::create_dir(world.at("locked")).unwrap();
    fs::set_permissions(world.at("locked"), fs::Permissions::from_mode(0o555)).unwrap();
    fs::copy(world.at("shots/1.lfp"), world.at("secret.lfp")).unwrap();
    fs::set_permissions(world.at("secret.lfp"), fs::Permissions::from_mode(0o000)).unwrap();
    fs::set_permissions(world.folder.path(), fs::Permissions::from_mode(0o755)).unwrap();
    // Nothing is forbidden to root: the program then runs as nobody.
    let root = fs::metadata("/proc/self").is_ok_and(|m| m.uid() == 0);
    let run = |arguments: &[&str]| {
        let mut command = world.command(arguments);
        if root {
            command.uid(65534).gid(65534);
        }
        command.output()
    };
    match run(&["--version"]) {
        Ok(output) if output.status.success() => {}
        _ => {
            return skip(Skip::Excused, "nobody but root can run the program where it stands");
        }
    }
    for work in [
        &["decode", "shots/1.lfp", "-c", "cam.calib", "--out", "locked/a", "--size", "80", "--views", "1"][..],
        &["infer", "field.npy", "--out", "locked/a.npy", "--scale", "2", "--dictionary", "small.lfd", "--fast"],
        &["calibrate", "white.lfp", "--out", "locked/a.calib"],
        &["train-dict", "photos", "--parameters", "train.json", "--out", "locked/a.lfd"],
    ] {
        failed(&run(work).unwrap(), &["locked/", "ermission denied"]);
    }
    for work in [
        &["info", "secret.lfp"][..],
        &["decode", "secret.lfp", "-c", "cam.calib", "--out", "locked/a"],
        &["calibrate", "secret.lfp", "--out", "locked/a.calib"],
    ] {
        failed(&run(work).unwrap(), &["secret.lfp", "ermission denied"]);
    }
    assert_eq!(fs::read_dir(world.at("locked")).unwrap().count(), 0);
}

#[test]
fn an_output_folder_that_vanishes() {
    let world = World::new();
    let work = ["decode", "shots/1.lfp", "-c", "cam.calib", "--out", "out/a", "--size", "200", "--views", "7"];
    // Views are being written: their folder stands under its unfinished name.
    let writing = || !unfinished(&world.at("out")).is_empty();
    for _ in 0..tiny::ATTEMPTS {
        let mut child = world.command(&work).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        while !writing() && child.try_wait().unwrap().is_none() {
            std::thread::yield_now();
        }
        // Held while its folder goes away, so that nothing is made in it meanwhile.
        let held = tiny::signal(&child, "STOP") && tiny::stands_still(&child) && writing();
        let _ = fs::remove_dir_all(world.at("out"));
        tiny::signal(&child, "CONT");
        let output = child.wait_with_output().unwrap();
        assert!(!world.at("out/a").exists());
        if held {
            return failed(&output, &["out/"]);
        }
    }
    panic!("in {} runs none was met while it wrote its views", tiny::ATTEMPTS);
}

#[cfg(target_os = "linux")]
#[test]
fn odd_names_and_links() {
    use std::os::unix::ffi::OsStrExt;
    let world = World::new();
    let odd = Path::new(std::ffi::OsStr::from_bytes(b"a b\xff\xfe.lfp"));
    fs::copy(world.at("shots/1.lfp"), world.folder.path().join(odd)).unwrap();
    std::os::unix::fs::symlink("shots/1.lfp", world.at("link.lfp")).unwrap();
    std::os::unix::fs::symlink("link-to-itself", world.at("link-to-itself")).unwrap();
    for (input, out) in [(odd, odd.with_extension("lf")), (Path::new("link.lfp"), PathBuf::from("a b.lf"))] {
        let options = ["-c", "cam.calib", "--size", "40", "--views", "1", "--out"];
        let output = world.command(&["decode"]).arg(input).args(options).arg(&out).output().unwrap();
        assert!(output.status.success(), "{}", said(&output));
        assert!(world.folder.path().join(&out).join("view_00_00.png").exists());
    }
    failed(&world.run(&["info", "link-to-itself"]), &["link-to-itself"]);
    // An output that is a link is neither followed nor replaced.
    fs::write(world.at("precious"), "mine").unwrap();
    std::os::unix::fs::symlink("precious", world.at("out.calib")).unwrap();
    failed(&world.run(&["calibrate", "white.lfp", "--out", "out.calib"]), &["out.calib"]);
    failed(&world.run(&["calibrate", "white.lfp", "--out", "out.calib", "--force"]), &["out.calib", "a link"]);
    assert_eq!(fs::read_link(world.at("out.calib")).unwrap(), Path::new("precious"));
    assert_eq!(fs::read(world.at("precious")).unwrap(), b"mine");
}
