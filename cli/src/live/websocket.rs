//! Lines of JSON for clients that connect by WebSocket, such as a page in a browser.
//!
//! Clients only read: their own messages are discarded. A browser would let pages of other sites connect
//! too, so these are refused. One thread performs all handshakes at once, so that no client waits for
//! another.

use std::{
    collections::VecDeque,
    io,
    net::{TcpListener, TcpStream},
    sync::{Arc, Mutex, PoisonError},
    thread,
    time::{Duration, Instant},
};

use anyface::{Error, Result};
use tungstenite::{
    HandshakeError, Message, WebSocket, accept_hdr_with_config,
    handshake::{
        MidHandshake,
        server::{ErrorResponse, Request, Response, ServerHandshake},
    },
    http::{StatusCode, header::ORIGIN},
    protocol::WebSocketConfig,
};

use super::address::Address;

/// The longest time that a handshake may take.
const GREETING: Duration = Duration::from_secs(2);
/// The most handshakes at a time. One more ends the oldest of them.
const MAX_GREETINGS: usize = 64;
/// Time between two looks at clients that are in their handshakes.
const GREETING_PAUSE: Duration = Duration::from_millis(5);
/// The most bytes that may wait for a reader before it counts as too slow: some seconds of frames.
const MAX_WAITING: usize = 256 << 10;
/// The most bytes that a message of a reader may have. Its content is ignored.
const MAX_RECEIVED: usize = 4 << 10;
/// The most messages of a reader that are discarded at a time.
const MAX_READ: usize = 16;
/// The most readers at a time. More than this are not the user's own.
const MAX_READERS: usize = 128;

type Readers = Arc<Mutex<Vec<WebSocket<TcpStream>>>>;

/// All connected readers.
pub struct Broadcast {
    readers: Readers,
    name: String,
}

impl Broadcast {
    /// From now on, lets readers connect at `address`.
    ///
    /// # Errors
    /// `InvalidInput` if the address is not one of this machine or its port is in use.
    pub fn new(option: &str, address: &Address) -> Result<Broadcast> {
        let at = address.find(option)?;
        let listener = TcpListener::bind(at).map_err(|error| {
            let why = match error.kind() {
                io::ErrorKind::AddrInUse => "one that is in use".to_owned(),
                _ => error.to_string(),
            };
            Error::InvalidInput(format!(
                "{option} {address}: expected a free port of this machine, got {why}; port 0 takes any that is free"
            ))
        })?;
        let at = listener
            .local_addr()
            .map_err(Error::io(address.to_string()))?;
        let readers = Readers::default();
        let new = Arc::clone(&readers);
        thread::spawn(move || greet_all(&listener, &new, GREETING));
        Ok(Broadcast {
            readers,
            name: format!("JSON lines to readers of ws://{at}"),
        })
    }

    /// Format and address, for messages to the user.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Sends a line to all readers without waiting. Drops readers that are gone or too slow.
    pub fn send(&mut self, line: &str) {
        self.readers().retain_mut(|reader| {
            // Without a read, the close frames and pings of the reader would go unnoticed.
            let gone = (0..MAX_READ).find_map(|_| reader.read().err());
            let sent = reader.send(Message::text(line)).err();
            gone.iter().chain(&sent).all(is_later)
        });
    }

    fn readers(&self) -> std::sync::MutexGuard<'_, Vec<WebSocket<TcpStream>>> {
        self.readers.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Broadcast {
    /// Sends every reader a close frame.
    fn drop(&mut self) {
        for reader in self.readers().iter_mut() {
            // A reader that takes nothing more gets none.
            let _ = reader.close(None);
            let _ = reader.flush();
        }
    }
}

/// Whether the error only means that nothing can be read or written at the moment.
fn is_later(error: &tungstenite::Error) -> bool {
    matches!(error, tungstenite::Error::Io(error) if error.kind() == io::ErrorKind::WouldBlock)
}

/// Looks at the headers of a client.
type Check = fn(&Request, Response) -> Result<Response, ErrorResponse>;
type Handshake = ServerHandshake<TcpStream, Check>;

/// A client in its handshake.
struct Greeting {
    since: Instant,
    handshake: MidHandshake<Handshake>,
}

/// Performs the handshakes of all clients at once, as long as the process lives. A handshake that takes longer than
/// `longest` ends.
fn greet_all(listener: &TcpListener, readers: &Readers, longest: Duration) {
    let mut greetings = VecDeque::new();
    loop {
        // While no client is in its handshake, this thread sleeps until one connects.
        let _ = listener.set_nonblocking(!greetings.is_empty());
        let client = match listener.accept() {
            Ok((stream, _)) => begin(stream),
            Err(_) => {
                thread::sleep(GREETING_PAUSE);
                None
            }
        };
        let waiting = std::mem::take(&mut greetings).into_iter();
        let steps = waiting.map(|waiting: Greeting| (waiting.since, waiting.handshake.handshake()));
        for (since, step) in steps.chain(client.map(|step| (Instant::now(), step))) {
            match step {
                Ok(reader) => admit(readers, reader),
                Err(HandshakeError::Interrupted(handshake)) if since.elapsed() < longest => {
                    greetings.push_back(Greeting { since, handshake });
                }
                Err(_) => {}
            }
        }
        greetings.drain(..greetings.len().saturating_sub(MAX_GREETINGS));
    }
}

fn admit(readers: &Readers, reader: WebSocket<TcpStream>) {
    let mut readers = readers.lock().unwrap_or_else(PoisonError::into_inner);
    if readers.len() < MAX_READERS {
        readers.push(reader);
    }
}

/// Begins a handshake, and goes as far as the client has sent. `None` if the client has gone.
fn begin(stream: TcpStream) -> Option<Result<WebSocket<TcpStream>, HandshakeError<Handshake>>> {
    stream.set_nonblocking(true).ok()?;
    stream.set_nodelay(true).ok()?;
    let config = WebSocketConfig::default()
        .read_buffer_size(MAX_RECEIVED)
        .write_buffer_size(0)
        .max_write_buffer_size(MAX_WAITING)
        .max_message_size(Some(MAX_RECEIVED))
        .max_frame_size(Some(MAX_RECEIVED));
    Some(accept_hdr_with_config(stream, check as Check, Some(config)))
}

#[expect(clippy::result_large_err, reason = "the type is tungstenite's")]
fn check(request: &Request, response: Response) -> Result<Response, ErrorResponse> {
    let mut origins = request.headers().get_all(ORIGIN).iter();
    if origins.all(|origin| origin.to_str().is_ok_and(is_ours)) {
        return Ok(response);
    }
    let mut refusal = ErrorResponse::new(Some("expected a page from this machine".to_owned()));
    *refusal.status_mut() = StatusCode::FORBIDDEN;
    Err(refusal)
}

/// Whether a page of this origin comes from a server on this machine, or from a file in a program that says so. Browsers
/// call the origin of a file "null", but that of a sandboxed frame of any site, too.
fn is_ours(origin: &str) -> bool {
    if origin == "file://" {
        return true;
    }
    let Some((_, place)) = origin.split_once("://") else {
        return false;
    };
    let host = match place.rsplit_once(':') {
        Some((host, port)) if port.parse::<u16>().is_ok() => host,
        _ => place,
    };
    ["localhost", "127.0.0.1", "[::1]"].contains(&host)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};

    use tungstenite::{client::IntoClientRequest, connect};

    fn broadcast() -> (Broadcast, String) {
        let broadcast = Broadcast::new("--websocket", &"127.0.0.1:0".parse().unwrap()).unwrap();
        let place = broadcast.name().rsplit(' ').next().unwrap().to_owned();
        (broadcast, place)
    }

    #[test]
    fn readers_receive_lines_and_what_they_send_is_ignored() {
        let (mut broadcast, place) = broadcast();
        let (mut reader, _) = connect(&place).unwrap();
        reader.send(Message::text("ignored")).unwrap();
        while broadcast.readers().is_empty() {
            thread::yield_now();
        }
        broadcast.send("one");
        broadcast.send("two");
        assert_eq!(reader.read().unwrap(), Message::text("one"));
        assert_eq!(reader.read().unwrap(), Message::text("two"));
        drop(broadcast);
        assert!(reader.read().unwrap().is_close());
    }

    /// A server whose handshakes may take this long, and its address.
    fn server(longest: Duration) -> std::net::SocketAddr {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let at = listener.local_addr().unwrap();
        thread::spawn(move || greet_all(&listener, &Readers::default(), longest));
        at
    }

    #[test]
    fn nobody_waits_for_silent_clients() {
        let at = server(Duration::from_secs(3600));
        let silent = |_| TcpStream::connect(at).unwrap();
        let mut clients: Vec<TcpStream> = (0..MAX_GREETINGS + 20).map(silent).collect();
        clients[MAX_GREETINGS]
            .write_all(b"GET / HTTP/1.1\r\nX: a")
            .unwrap();
        connect(format!("ws://{at}")).unwrap();
        // The oldest ones made room, the others are still let connect.
        let last = clients.last_mut().unwrap();
        last.set_nonblocking(true).unwrap();
        let error = last.read(&mut [0]).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::WouldBlock);
        assert_eq!(clients[0].read(&mut [0]).unwrap(), 0);
    }

    #[test]
    fn a_client_that_dribbles_is_let_go() {
        let at = server(Duration::from_millis(50));
        let mut client = TcpStream::connect(at).unwrap();
        // The write fails once the server has closed the connection.
        while client.write_all(b"a").is_ok() {
            thread::sleep(Duration::from_millis(5));
        }
    }

    #[test]
    fn who_does_not_read_is_let_go_and_holds_nobody_up() {
        let (mut broadcast, place) = broadcast();
        let reader = connect(&place).unwrap();
        while broadcast.readers().is_empty() {
            thread::yield_now();
        }
        let line = "x".repeat(4000);
        for _ in 0..20_000 {
            broadcast.send(&line);
            if broadcast.readers().is_empty() {
                drop(reader);
                return;
            }
        }
        panic!("80 MB wait for a reader who does not read");
    }

    #[test]
    fn pages_of_other_sites_are_refused() {
        let (_broadcast, place) = broadcast();
        let mut request = place.into_client_request().unwrap();
        let origin = "https://example.com".parse().unwrap();
        request.headers_mut().insert(ORIGIN, origin);
        assert!(connect(request).is_err());
        for ours in [
            "file://",
            "http://localhost",
            "http://127.0.0.1:8080",
            "https://[::1]:9",
        ] {
            assert!(is_ours(ours), "{ours}");
        }
        for other in [
            "",
            "null",
            "http://localhost.example.com",
            "http://192.168.1.2",
            "localhost",
        ] {
            assert!(!is_ours(other), "{other}");
        }
    }

    #[test]
    fn a_port_in_use_is_refused_with_a_way_out() {
        let (_broadcast, place) = broadcast();
        let address = place.trim_start_matches("ws://").parse().unwrap();
        let error = Broadcast::new("--websocket", &address)
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains("got one that is in use; port 0"), "{error}");
    }
}
