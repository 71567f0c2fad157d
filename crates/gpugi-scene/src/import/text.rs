//! Text of files: as programs save it, and as messages show it.

/// The bytes of a text file without its byte order mark.
///
/// # Errors
/// The text is UTF-16.
pub fn without_mark(bytes: &[u8]) -> Result<&[u8], String> {
    // Every format that gpugi reads as text begins with a character of ASCII, whose other half is zero.
    let is_wide = bytes
        .first_chunk()
        .is_some_and(|&first| matches!(first, [0xff, 0xfe] | [0xfe, 0xff]) || first.contains(&0));
    if is_wide {
        return Err("this is UTF-16 text; save it as UTF-8".into());
    }
    Ok(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes))
}

/// The beginning of a text from a file, for messages.
pub(crate) fn quoted(text: &str) -> String {
    const MOST: usize = 60;
    let mut shown: String = text.chars().take(MOST).collect();
    if text.chars().nth(MOST).is_some() {
        shown.push_str("...");
    }
    shown
}
