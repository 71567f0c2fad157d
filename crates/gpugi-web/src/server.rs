//! A web server of one folder, for this machine only.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;

/// Longest request (bytes), and longest time that one may take.
const MOST_BYTES: u64 = 16 << 10;
const PATIENCE: Duration = Duration::from_secs(10);

/// Files by their path from the root: nothing else is ever read.
type Site = BTreeMap<String, Vec<u8>>;

/// The server, before it runs.
pub struct Server {
    /// `http://HOST:PORT`
    pub address: String,
    listener: TcpListener,
    site: Arc<Site>,
}

impl Server {
    /// Reads the files of `folder` and opens a port; 0 stands for any that is free.
    pub fn new(folder: &Path, port: u16) -> anyhow::Result<Self> {
        let mut site = Site::new();
        read(folder, "", &mut site).with_context(|| folder.display().to_string())?;
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port));
        let listener = listener.with_context(|| format!("port {port}"))?;
        Ok(Self {
            address: format!("http://{}", listener.local_addr()?),
            listener,
            site: Arc::new(site),
        })
    }

    /// Answers requests until the program ends.
    pub fn run(&self) {
        for stream in self.listener.incoming().flatten() {
            let site = self.site.clone();
            // Browsers also open connections that they may need later; none may keep the others waiting.
            std::thread::spawn(move || answer(&stream, &site).ok());
        }
    }
}

fn read(folder: &Path, prefix: &str, site: &mut Site) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            read(&entry.path(), &format!("{name}/"), site)?;
        } else {
            site.insert(name, fs::read(entry.path())?);
        }
    }
    Ok(())
}

/// Answers one request and closes the connection.
fn answer(mut stream: &TcpStream, site: &Site) -> io::Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    let mut lines = BufReader::new(stream.take(MOST_BYTES)).lines();
    let request = lines.next().unwrap_or(Ok(String::new()))?;
    // A connection that is closed before everything sent has been read looks broken to the browser.
    while lines
        .next()
        .is_some_and(|line| line.is_ok_and(|line| !line.is_empty()))
    {}
    let mut words = request.split(' ');
    let (method, target) = (words.next(), words.next().unwrap_or(""));
    let path = target
        .split('?')
        .next()
        .unwrap_or("")
        .trim_start_matches('/');
    let path = if path.is_empty() { "index.html" } else { path };
    let (status, body) = match (method, site.get(path)) {
        (Some("GET"), Some(body)) => ("200 OK", &body[..]),
        _ => ("404 Not Found", &b""[..]),
    };
    let kind = match path.rsplit('.').next() {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript",
        Some("wasm") => "application/wasm",
        _ => "application/octet-stream",
    };
    let length = body.len();
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nCache-Control: no-cache\r\n\
         Connection: close\r\n\r\n"
    )?;
    stream.write_all(body)
}
