//! Chromium, where there is one, driven over its debugging pipe: pages are opened, clicked, dragged, typed at and looked at
//! as a user does it, in real time, and what they complain about is collected.

#![allow(dead_code)] // every user of this file needs another part of it

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use base64::Engine as _;
use serde_json::{Value, json};

/// Nothing a page is asked for takes longer, however busy the machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// A browser with one page.
pub struct Browser {
    child: Child,
    to: ChildStdin,
    from: Receiver<Value>,
    next: u64,
    session: Option<String>,
    complaints: Vec<String>,
    loaded: bool,
    _profile: tempfile::TempDir,
}

impl Browser {
    /// A browser without a window, drawing in software; without Chromium the rest of the calling test is skipped.
    #[track_caller]
    pub fn start() -> Option<Browser> {
        let program = lenslet_test_support::chromium()?;
        let profile = tempfile::tempdir().unwrap();
        // The pipe's ends are file 3 and 4 of the browser.
        let mut child = Command::new("/bin/sh")
            .args(["-c", "exec \"$0\" \"$@\" 3<&0 4>&1 </dev/null >/dev/null 2>/dev/null"])
            .arg(program)
            .args(["--headless", "--no-sandbox", "--disable-background-networking", "--no-first-run"])
            .args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--remote-debugging-pipe"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let to = child.stdin.take().unwrap();
        let mut output = BufReader::new(child.stdout.take().unwrap());
        let (send, from) = channel();
        std::thread::spawn(move || {
            let mut message = Vec::new();
            while output.read_until(0, &mut message).is_ok_and(|n| n > 0) {
                message.pop();
                let Ok(value) = serde_json::from_slice(&message) else { break };
                if send.send(value).is_err() {
                    break;
                }
                message.clear();
            }
        });
        let mut browser = Browser {
            child,
            to,
            from,
            next: 0,
            session: None,
            complaints: Vec::new(),
            loaded: false,
            _profile: profile,
        };
        let target = browser.call("Target.createTarget", json!({ "url": "about:blank" }));
        let attached =
            browser.call("Target.attachToTarget", json!({ "targetId": target["targetId"], "flatten": true }));
        browser.session = attached["sessionId"].as_str().map(str::to_owned);
        for domain in ["Page", "Runtime", "Log"] {
            browser.call(&format!("{domain}.enable"), json!({}));
        }
        Some(browser)
    }

    /// One command of the debugging protocol and its result.
    pub fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.next += 1;
        let mut message = json!({ "id": self.next, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        let mut bytes = serde_json::to_vec(&message).unwrap();
        bytes.push(0);
        self.to.write_all(&bytes).unwrap();
        let end = Instant::now() + PATIENCE;
        loop {
            let answer = self.receive(end, method);
            if answer["id"] == self.next {
                assert!(answer["error"].is_null(), "{method}: {}", answer["error"]);
                return answer["result"].clone();
            }
        }
    }

    /// The next message; keeps what events tell.
    fn receive(&mut self, end: Instant, waiting: &str) -> Value {
        let left = end.saturating_duration_since(Instant::now());
        let message = self.from.recv_timeout(left).unwrap_or_else(|e| panic!("{waiting}: {e}"));
        let told = &message["params"];
        match message["method"].as_str() {
            Some("Page.loadEventFired") => self.loaded = true,
            Some("Runtime.exceptionThrown") => self.complaints.push(told["exceptionDetails"].to_string()),
            Some("Log.entryAdded") if told["entry"]["level"] == "error" => {
                self.complaints.push(told["entry"]["text"].to_string());
            }
            Some("Runtime.consoleAPICalled") if told["type"] == "error" || told["type"] == "warning" => {
                self.complaints.push(told["args"].to_string());
            }
            _ => {}
        }
        message
    }

    /// Sets the window's size in pixels, and light or dark.
    pub fn window(&mut self, width: u32, height: u32, dark: bool) {
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", size);
        let scheme = if dark { "dark" } else { "light" };
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        self.call("Emulation.setEmulatedMedia", json!({ "features": features }));
    }

    /// Opens a file, with what follows `#` in its address, and waits until it is loaded.
    pub fn open(&mut self, page: &Path, hash: &str) {
        // From another document, so that a new hash alone loads the page again.
        for address in ["about:blank".to_owned(), format!("file://{}#{hash}", page.display())] {
            self.loaded = false;
            self.call("Page.navigate", json!({ "url": address }));
            let end = Instant::now() + PATIENCE;
            while !self.loaded {
                self.receive(end, "loading");
            }
        }
    }

    /// The value of an expression in the page; promises are waited for.
    pub fn value(&mut self, expression: &str) -> Value {
        let how = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let result = self.call("Runtime.evaluate", how);
        assert!(result["exceptionDetails"].is_null(), "{expression}: {result}");
        result["result"]["value"].clone()
    }

    /// Waits until an expression is true.
    pub fn wait(&mut self, expression: &str) {
        let end = Instant::now() + PATIENCE;
        while self.value(&format!("!!({expression})")) != true {
            assert!(Instant::now() < end, "never came true: {expression}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Middle and size of an element in the window: x, y, width, height.
    pub fn place(&mut self, selector: &str) -> [f64; 4] {
        let text = format!(
            "(() => {{ const e = document.querySelector({}); e.scrollIntoView({{ block: 'center' }}); \
             const r = e.getBoundingClientRect(); return [r.left + r.width / 2, r.top + r.height / 2, r.width, r.height]; }})()",
            json!(selector)
        );
        let value = self.value(&text);
        [0, 1, 2, 3].map(|k| value[k].as_f64().unwrap())
    }

    /// The mouse: `mousePressed`, `mouseReleased` or `mouseMoved`, with the left button held or not.
    pub fn mouse(&mut self, kind: &str, x: f64, y: f64, held: bool) {
        let (button, buttons) = if held { ("left", 1) } else { ("none", 0) };
        let button = if kind == "mouseReleased" { "left" } else { button };
        let event = json!({ "type": kind, "x": x, "y": y, "button": button, "buttons": buttons, "clickCount": 1 });
        self.call("Input.dispatchMouseEvent", event);
    }

    /// Presses and lets go in one place.
    pub fn click(&mut self, x: f64, y: f64) {
        self.mouse("mousePressed", x, y, true);
        self.mouse("mouseReleased", x, y, false);
    }

    /// Presses, moves in `steps`, lets go.
    pub fn drag(&mut self, from: [f64; 2], to: [f64; 2], steps: u32) {
        self.mouse("mousePressed", from[0], from[1], true);
        for k in 1..=steps {
            let f = f64::from(k) / f64::from(steps);
            self.mouse("mouseMoved", from[0] + f * (to[0] - from[0]), from[1] + f * (to[1] - from[1]), true);
        }
        self.mouse("mouseReleased", to[0], to[1], false);
    }

    /// The wheel.
    pub fn wheel(&mut self, x: f64, y: f64, by: f64) {
        let event = json!({ "type": "mouseWheel", "x": x, "y": y, "deltaX": 0, "deltaY": by });
        self.call("Input.dispatchMouseEvent", event);
    }

    /// Fingers: `touchStart`, `touchMove`, `touchEnd` with the fingers that are down.
    pub fn touch(&mut self, kind: &str, fingers: &[[f64; 2]]) {
        let points: Vec<Value> =
            fingers.iter().enumerate().map(|(k, p)| json!({ "x": p[0], "y": p[1], "id": k })).collect();
        self.call("Input.dispatchTouchEvent", json!({ "type": kind, "touchPoints": points }));
    }

    /// Presses a key by its name, such as `ArrowLeft` or `m`.
    pub fn key(&mut self, name: &str) {
        let code = match name {
            "ArrowLeft" => 37,
            "ArrowUp" => 38,
            "ArrowRight" => 39,
            "ArrowDown" => 40,
            "Tab" => 9,
            _ => 0,
        };
        let letter = name.chars().count() == 1;
        for kind in [if letter { "keyDown" } else { "rawKeyDown" }, "keyUp"] {
            let mut event = json!({ "type": kind, "key": name, "code": name, "windowsVirtualKeyCode": code });
            if kind == "keyDown" {
                event["text"] = json!(name);
            }
            self.call("Input.dispatchKeyEvent", event);
        }
    }

    /// A picture of the window, or of the whole page; PNG.
    pub fn screenshot(&mut self, whole: bool) -> Vec<u8> {
        let how = json!({ "format": "png", "captureBeyondViewport": whole });
        let text = self.call("Page.captureScreenshot", how);
        base64::engine::general_purpose::STANDARD.decode(text["data"].as_str().unwrap()).unwrap()
    }

    /// CPU seconds of the browser and all its helpers so far; only where there is a /proc.
    pub fn cpu_seconds(&self) -> f64 {
        // Of every process: its parent and the time it took, in steps of 10 ms.
        let mut processes = std::collections::BTreeMap::new();
        for entry in std::fs::read_dir("/proc").into_iter().flatten().flatten() {
            let Some(id) = entry.file_name().to_str().and_then(|n| n.parse::<u32>().ok()) else { continue };
            let text = std::fs::read_to_string(entry.path().join("stat")).unwrap_or_default();
            let Some((_, rest)) = text.rsplit_once(')') else { continue };
            let fields: Vec<f64> = rest.split_whitespace().map(|f| f.parse().unwrap_or(0.0)).collect();
            if fields.len() > 12 {
                processes.insert(id, (fields[1] as u32, (fields[11] + fields[12]) / 100.0));
            }
        }
        let ours = |mut id: u32| {
            while let Some((parent, _)) = processes.get(&id).filter(|_| id != self.child.id()) {
                id = *parent;
            }
            id == self.child.id()
        };
        processes.iter().filter(|(id, _)| ours(**id)).map(|(_, (_, seconds))| seconds).sum()
    }

    /// Errors and warnings of the pages so far.
    pub fn complaints(&self) -> &[String] {
        &self.complaints
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
