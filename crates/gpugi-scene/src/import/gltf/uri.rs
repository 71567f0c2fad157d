//! Reads data URIs and percent-encoded relative URIs.

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

use crate::Resolver;
use crate::import::quoted;

/// Base64 as exporters write it, with or without padding.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// The bytes that `uri` contains or refers to.
pub fn read(uri: &str, resolver: &dyn Resolver) -> Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (kind, content) = data
            .split_once(',')
            .ok_or("the data URI has no comma before its content")?;
        if kind.ends_with(";base64") {
            return BASE64
                .decode(content)
                .map_err(|error| format!("the data URI is no base64: {error}"));
        }
        return Ok(percent_decoded(content));
    }
    if let Some((scheme, _)) = uri.split_once("://") {
        return Err(format!(
            "{} addresses are not read; copy the file beside this one",
            quoted(scheme)
        ));
    }
    let decoded = String::from_utf8(percent_decoded(uri))
        .map_err(|_| format!("\"{}\" is not UTF-8 once decoded", quoted(uri)))?;
    resolver
        .read(&decoded)
        .map_err(|reason| format!("cannot read \"{}\": {reason}", quoted(&decoded)))
}

fn percent_decoded(text: &str) -> Vec<u8> {
    let digit = |byte: Option<&u8>| byte.and_then(|byte| char::from(*byte).to_digit(16));
    let mut rest = text.as_bytes();
    let mut decoded = Vec::with_capacity(rest.len());
    while let [first, tail @ ..] = rest {
        rest = tail;
        decoded.push(*first);
        if *first == b'%'
            && let (Some(high), Some(low)) = (digit(tail.first()), digit(tail.get(1)))
        {
            // Two hexadecimal digits fit into a byte.
            decoded.pop();
            decoded.push((high * 16 + low) as u8);
            rest = &tail[2..];
        }
    }
    decoded
}
