//! A web server of one folder, on this machine only, to which pages post what they have to say.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};

/// A page's `POST /name`.
pub struct Message {
    pub name: String,
    pub body: Vec<u8>,
}

pub struct Server {
    /// `http://HOST:PORT`
    pub address: String,
    pub messages: Receiver<Message>,
}

impl Server {
    /// Serves `site` until the program ends.
    pub fn start(site: PathBuf) -> io::Result<Self> {
        let listener = TcpListener::bind("127.0.0.1:0")?;
        let address = format!("http://{}", listener.local_addr()?);
        let (sender, messages) = channel();
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let (site, sender) = (site.clone(), sender.clone());
                // Browsers also open connections that they may need later; none may keep the others waiting.
                std::thread::spawn(move || answer(stream, &site, &sender).ok());
            }
        });
        Ok(Self { address, messages })
    }
}

/// Answers one request and closes the connection.
fn answer(mut stream: TcpStream, site: &Path, sender: &Sender<Message>) -> io::Result<()> {
    let mut reader = BufReader::new(stream.try_clone()?);
    let mut request = String::new();
    reader.read_line(&mut request)?;
    let mut length = 0;
    loop {
        let mut header = String::new();
        reader.read_line(&mut header)?;
        match header.trim().split_once(':') {
            Some((name, value)) if name.eq_ignore_ascii_case("content-length") => {
                length = value.trim().parse().map_err(io::Error::other)?;
            }
            Some(_) => {}
            None => break,
        }
    }
    let mut words = request.split(' ');
    let (method, target) = (words.next().unwrap_or(""), words.next().unwrap_or(""));
    let path = target
        .split('?')
        .next()
        .unwrap_or("")
        .trim_start_matches('/');
    let mut body = Vec::new();
    if method == "POST" {
        reader.take(length).read_to_end(&mut body)?;
        let name = path.to_owned();
        sender
            .send(Message {
                name,
                body: std::mem::take(&mut body),
            })
            .ok();
    }
    let mut status = "200 OK";
    if method == "GET" {
        body = std::fs::read(site.join(path)).unwrap_or_else(|_| {
            status = "404 Not Found";
            Vec::new()
        });
    }
    let kind = match path.rsplit('.').next() {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript",
        Some("wasm") => "application/wasm",
        _ => "application/octet-stream",
    };
    let length = body.len();
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
    )?;
    stream.write_all(&body)
}
