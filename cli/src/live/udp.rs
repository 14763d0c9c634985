//! UDP datagrams to one receiver.

use std::{
    io::ErrorKind,
    net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket},
};

use anyface::{Error, Result};

use super::{address::Address, frame::Frame};

/// Turns a frame into a datagram.
type Packets = Box<dyn Fn(&Frame) -> Vec<u8>>;

/// A receiver of datagrams. Nothing is read back from it.
pub struct Datagrams {
    socket: UdpSocket,
    packet: Packets,
    /// Format and address, as messages name them.
    name: String,
    is_complaining: bool,
}

impl Datagrams {
    /// Opens a socket that sends to `address`, the value of `option`.
    ///
    /// # Errors
    /// `InvalidInput` if the machine cannot be found or reached.
    pub fn new(
        option: &str,
        format: &str,
        address: &Address,
        packet: Packets,
    ) -> Result<Datagrams> {
        let to = address.find(option)?;
        let socket = open(to).map_err(|error| {
            Error::InvalidInput(format!(
                "{option} {address}: expected a machine that can be reached, got {error}"
            ))
        })?;
        Ok(Datagrams {
            socket,
            packet,
            name: format!("{format} to {to} (UDP)"),
            is_complaining: false,
        })
    }

    /// Format and address, for messages to the user.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Sends a frame. If the receiver is not there yet, the frame is lost without an error. Of several
    /// other failures in a row, the first is returned as a sentence.
    pub fn send(&mut self, frame: &Frame) -> Option<String> {
        let sent = self.socket.send(&(self.packet)(frame));
        let error = sent.err().filter(|error| {
            // Nobody listens there yet, or the system's buffer is full at the moment.
            !matches!(
                error.kind(),
                ErrorKind::ConnectionRefused | ErrorKind::WouldBlock
            )
        });
        let was_complaining = std::mem::replace(&mut self.is_complaining, error.is_some());
        let error = error.filter(|_| !was_complaining)?;
        Some(format!(
            "{}: {error}; the next frames are tried all the same",
            self.name
        ))
    }
}

/// A socket that sends to one receiver. If that is a loopback address, the socket is bound to loopback too.
fn open(to: SocketAddr) -> std::io::Result<UdpSocket> {
    let from: SocketAddr = match (to.is_ipv6(), to.ip().is_loopback()) {
        (false, true) => (Ipv4Addr::LOCALHOST, 0).into(),
        (false, false) => (Ipv4Addr::UNSPECIFIED, 0).into(),
        (true, true) => (Ipv6Addr::LOCALHOST, 0).into(),
        (true, false) => (Ipv6Addr::UNSPECIFIED, 0).into(),
    };
    let socket = UdpSocket::bind(from)?;
    socket.connect(to)?;
    Ok(socket)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_arrive_whether_or_not_somebody_listened_before() {
        let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
        let at = receiver.local_addr().unwrap();
        drop(receiver);
        let packet = |frame: &Frame| frame.number.to_be_bytes().to_vec();
        let address = at.to_string().parse().unwrap();
        let mut datagrams = Datagrams::new("--osc", "OSC", &address, Box::new(packet)).unwrap();
        assert_eq!(datagrams.name(), format!("OSC to {at} (UDP)"));
        for _ in 0..3 {
            assert_eq!(datagrams.send(&Frame::at_rest()), None);
        }
        let receiver = UdpSocket::bind(at).unwrap();
        // The first send may still report an earlier refusal and lose its frame.
        for _ in 0..2 {
            assert_eq!(datagrams.send(&Frame::at_rest()), None);
        }
        let mut bytes = [0; 8];
        assert_eq!(receiver.recv(&mut bytes).unwrap(), 4);
        assert_eq!(bytes[..4], [0, 0, 0, 3]);
    }
}
