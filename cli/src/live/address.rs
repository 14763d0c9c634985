//! Addresses as a user writes them.

use std::{
    fmt::{Display, Formatter},
    net::{SocketAddr, ToSocketAddrs},
    str::FromStr,
};

use anyface::{Error, Result};

/// The name or IP address of a machine, and a port.
#[derive(Debug, Clone, PartialEq)]
pub struct Address {
    host: String,
    port: u16,
}

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let wrong = || format!("expected HOST:PORT, as in 127.0.0.1:39539, got {text:?}");
        let (host, port) = text.rsplit_once(':').ok_or_else(wrong)?;
        let bare = host
            .strip_prefix('[')
            .and_then(|host| host.strip_suffix(']'));
        let is_plain = !host.contains(':') || bare.is_some();
        let is_name = |c: char| c.is_ascii_alphanumeric() || ".-_:%".contains(c);
        let host = bare.unwrap_or(host);
        let port = port.parse().map_err(|_| wrong())?;
        if is_plain && !host.is_empty() && host.chars().all(is_name) {
            Ok(Address {
                host: host.to_owned(),
                port,
            })
        } else {
            Err(wrong())
        }
    }
}

impl Display for Address {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        if self.host.contains(':') {
            write!(f, "[{}]:{}", self.host, self.port)
        } else {
            write!(f, "{}:{}", self.host, self.port)
        }
    }
}

impl Address {
    /// Looks up the machine's address. `option` is the option that named it, for the error.
    ///
    /// # Errors
    /// `InvalidInput` if the name cannot be resolved.
    pub fn find(&self, option: &str) -> Result<SocketAddr> {
        let addresses = (self.host.as_str(), self.port).to_socket_addrs();
        let first = addresses.map(|mut all| all.next());
        let why = match first {
            Ok(Some(address)) => return Ok(address),
            Ok(None) => "it has no address".to_owned(),
            Err(error) => error.to_string(),
        };
        Err(Error::InvalidInput(format!(
            "{option} {self}: expected a machine that can be found, got {why}; its number works too, as in 192.168.1.20:{}",
            self.port
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_numbers_are_read_and_shown_as_they_were_written() {
        for text in ["127.0.0.1:39539", "studio-2.local:9000", "[::1]:0"] {
            assert_eq!(text.parse::<Address>().unwrap().to_string(), text);
        }
    }

    #[test]
    fn what_is_no_address_is_refused_with_an_example() {
        for text in [
            "",
            "39539",
            "host",
            "host:",
            ":39539",
            "h:99999",
            "h:-1",
            "::1:5",
            "a b:5",
            "http://h:5",
        ] {
            let error = text.parse::<Address>().unwrap_err();
            assert!(
                error.contains("expected HOST:PORT, as in"),
                "{text}: {error}"
            );
        }
    }

    #[test]
    fn a_name_that_nobody_knows_is_an_error_that_says_so() {
        let address: Address = "nowhere.invalid:9".parse().unwrap();
        let error = address.find("--vmc").unwrap_err();
        assert!(
            error
                .to_string()
                .contains("--vmc nowhere.invalid:9: expected a machine"),
            "{error}"
        );
    }
}
