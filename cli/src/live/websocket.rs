//! Lines of JSON for clients that connect by WebSocket, such as a page in a browser.
//!
//! Clients only read: their own messages are discarded. A browser would let pages of other sites connect
//! too, so these are refused.

use std::{
    io,
    net::{TcpListener, TcpStream},
    sync::{Arc, Mutex, PoisonError},
    thread,
    time::Duration,
};

use anyface::{Error, Result};
use tungstenite::{
    Message, WebSocket, accept_hdr_with_config,
    handshake::server::{ErrorResponse, Request, Response},
    http::{StatusCode, header::ORIGIN},
    protocol::WebSocketConfig,
};

use super::address::Address;

/// Timeout for each read and write of the handshake, and for writes of the goodbye.
const GREETING: Duration = Duration::from_secs(2);
/// The most bytes that may wait for a reader before it counts as too slow: some seconds of frames.
const MOST_WAITING: usize = 256 << 10;
/// The most bytes that a message of a reader may have. Its content is ignored.
const MOST_RECEIVED: usize = 4 << 10;
/// The most messages of a reader that are discarded at a time.
const MOST_READ: usize = 16;
/// The most readers at a time. More than this are not the user's own.
const MOST_READERS: usize = 32;

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
        thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                if let Some(reader) = greet(stream) {
                    let mut readers = new.lock().unwrap_or_else(PoisonError::into_inner);
                    if readers.len() < MOST_READERS {
                        readers.push(reader);
                    }
                }
            }
        });
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
            let gone = (0..MOST_READ).find_map(|_| reader.read().err());
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
            let _ = reader.get_ref().set_nonblocking(false);
            let _ = reader.get_ref().set_write_timeout(Some(GREETING));
            let _ = reader.close(None);
            let _ = reader.flush();
        }
    }
}

/// Whether the error only means that nothing can be read or written at the moment.
fn is_later(error: &tungstenite::Error) -> bool {
    matches!(error, tungstenite::Error::Io(error) if error.kind() == io::ErrorKind::WouldBlock)
}

/// Performs the handshake. Returns `None` if it fails, takes too long or comes from a page of another site.
fn greet(stream: TcpStream) -> Option<WebSocket<TcpStream>> {
    stream.set_read_timeout(Some(GREETING)).ok()?;
    stream.set_write_timeout(Some(GREETING)).ok()?;
    stream.set_nodelay(true).ok()?;
    let config = WebSocketConfig::default()
        .read_buffer_size(MOST_RECEIVED)
        .write_buffer_size(0)
        .max_write_buffer_size(MOST_WAITING)
        .max_message_size(Some(MOST_RECEIVED))
        .max_frame_size(Some(MOST_RECEIVED));
    let reader = accept_hdr_with_config(stream, check, Some(config)).ok()?;
    reader.get_ref().set_nonblocking(true).ok()?;
    Some(reader)
}

#[expect(clippy::result_large_err, reason = "the type is tungstenite's")]
fn check(request: &Request, response: Response) -> Result<Response, ErrorResponse> {
    let origin = request.headers().get(ORIGIN);
    if origin.is_none_or(|origin| origin.to_str().is_ok_and(is_ours)) {
        return Ok(response);
    }
    let mut refusal = ErrorResponse::new(Some("expected a page from this machine".to_owned()));
    *refusal.status_mut() = StatusCode::FORBIDDEN;
    Err(refusal)
}

/// Whether a page of this origin comes from this machine: from a file or from a local server.
fn is_ours(origin: &str) -> bool {
    if ["null", "file://"].contains(&origin) {
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
            "null",
            "http://localhost",
            "http://127.0.0.1:8080",
            "https://[::1]:9",
        ] {
            assert!(is_ours(ours), "{ours}");
        }
        for other in [
            "",
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
