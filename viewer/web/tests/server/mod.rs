//! A server for the page and a scene, to which the page's script posts its pictures.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

/// The script that the server adds to the page. It posts what the test compares.
const SCRIPT: &str = include_str!("script.js");
/// The longest time for an answer. Chromium draws on the CPU here, perhaps beside other tests.
const PATIENCE: Duration = Duration::from_secs(180);

pub struct Server {
    pub port: u16,
    said: Receiver<(String, Vec<u8>)>,
}

impl Server {
    /// Serves the files of `page`, and `scene` under the name `name`, until the test ends.
    pub fn start(page: PathBuf, name: &'static str, scene: Vec<u8>) -> Server {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let (sender, said) = channel();
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                // A browser that goes away in the middle of a request needs no answer.
                let _ = answer(stream, &page, (name, &scene), &sender);
            }
        });
        Server { port, said }
    }

    /// The next thing that the page says, which must be `what`.
    pub fn next(&self, what: &str) -> Vec<u8> {
        let (said, bytes) = self.said.recv_timeout(PATIENCE).unwrap_or_else(|e| panic!("waiting for {what}: {e}"));
        assert_eq!(said, what, "{}", String::from_utf8_lossy(&bytes));
        bytes
    }
}

fn answer(
    stream: TcpStream,
    page: &Path,
    (name, scene): (&str, &[u8]),
    sender: &Sender<(String, Vec<u8>)>,
) -> std::io::Result<()> {
    let mut reader = BufReader::new(stream);
    let mut request = String::new();
    reader.read_line(&mut request)?;
    let mut length = 0;
    loop {
        let mut line = String::new();
        if reader.read_line(&mut line)? == 0 || line.trim().is_empty() {
            break;
        }
        if let Some(stated) = line.to_lowercase().strip_prefix("content-length:") {
            length = stated.trim().parse().unwrap_or(0);
        }
    }
    let path = request.split(' ').nth(1).unwrap_or("/").split('?').next().unwrap_or("/");
    let asked = path.trim_start_matches('/');
    let mut body = Vec::new();
    if request.starts_with("POST") {
        let mut said = vec![0; length];
        reader.read_exact(&mut said)?;
        let _ = sender.send((asked.to_string(), said));
    } else if asked == name {
        body = scene.to_vec();
    } else if asked == "script.js" {
        body = SCRIPT.into();
    } else if !asked.contains("..") {
        body = std::fs::read(page.join(asked)).unwrap_or_default();
        if asked == "index.html" {
            body.extend(b"<script type=\"module\" src=\"script.js\"></script>");
        }
    }
    let kind = match asked.rsplit('.').next() {
        Some("html") => "text/html",
        Some("js") => "text/javascript",
        Some("css") => "text/css",
        Some("wasm") => "application/wasm",
        _ => "application/octet-stream",
    };
    let mut stream = reader.into_inner();
    write!(
        stream,
        "HTTP/1.1 200 OK\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
        body.len()
    )?;
    stream.write_all(&body)
}
