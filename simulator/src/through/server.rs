//! The control's end of a measurement: a thread takes requests, the cycle runs them.

#![expect(clippy::disallowed_methods, reason = "the thread beside the cycle waits for requests")]

use core::net::SocketAddr;
use std::io::{self, BufRead as _, BufReader, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use super::{About, Answer, LINE_MAX, Point, Request};

/// A request with the place to answer to.
#[derive(Debug)]
pub struct Pending {
    /// What is to be run.
    pub request: Request,
    reply: SyncSender<Answer>,
}

impl Pending {
    /// Answers with the moments of the run.
    pub fn answer(self, points: Vec<Point>) {
        // whoever has hung up needs no answer
        let _ = self.reply.try_send(Answer::Points(points));
    }

    /// Answers that the request cannot be carried out.
    pub fn refuse(self, why: impl core::fmt::Display) {
        let _ = self.reply.try_send(Answer::Error(why.to_string()));
    }
}

/// The measuring port of a control. One client at a time.
#[derive(Debug)]
pub struct MeasuringPort {
    address: SocketAddr,
    requests: Receiver<Pending>,
}

impl MeasuringPort {
    /// Listens on loopback.
    ///
    /// # Errors
    /// The address is not of loopback, or not free.
    pub fn open(address: SocketAddr, about: About) -> io::Result<Self> {
        if !address.ip().to_canonical().is_loopback() {
            return Err(io::Error::other(
                "part programs are taken from this computer only: give an address of loopback",
            ));
        }
        let listener = TcpListener::bind(address)?;
        let address = listener.local_addr()?;
        let (send, requests) = sync_channel(1);
        std::thread::Builder::new().name("cnc-measure".into()).spawn(move || {
            for stream in listener.incoming().flatten() {
                // an end that hangs up ends its own connection only
                let _ = serve(&stream, &about, &send);
            }
        })?;
        Ok(Self { address, requests })
    }

    /// Where it listens.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// A request, where there is one.
    #[must_use]
    pub fn request(&self) -> Option<Pending> {
        self.requests.try_recv().ok()
    }
}

fn serve(stream: &TcpStream, about: &About, requests: &SyncSender<Pending>) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let mut writer = stream;
    let mut say = |text: Result<String, serde_json::Error>| -> io::Result<()> {
        writer.write_all((text.map_err(io::Error::other)? + "\n").as_bytes())
    };
    say(serde_json::to_string(about))?;
    let mut reader = BufReader::new(stream);
    loop {
        let mut line = String::new();
        if (&mut reader).take(LINE_MAX).read_line(&mut line)? == 0 {
            return Ok(());
        }
        let answer = match serde_json::from_str(&line) {
            Ok(request) => {
                let (reply, answer) = sync_channel(1);
                requests.send(Pending { request, reply }).map_err(io::Error::other)?;
                answer.recv().map_err(io::Error::other)?
            }
            Err(e) => Answer::Error(format!("no request: {e}")),
        };
        say(serde_json::to_string(&answer))?;
    }
}
