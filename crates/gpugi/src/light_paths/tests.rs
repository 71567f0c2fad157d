//! Tests patterns against expected paths and against the `regex` crate; overlap and gaps; hostile patterns.

use super::*;
use crate::techniques::Registry;

#[test]
fn patterns_describe_whole_paths() {
    for (pattern, path, expected) in [
        ("L[DG]E", "LDE", true),
        ("L[DG]E", "LGE", true),
        ("L[DG]E", "LSE", false),
        ("L[DG]E", "LDDE", false),
        ("LDD+E", "LDE", false),
        ("LDD+E", "LDDDE", true),
        ("LS+[DG]E", "LSSDE", true),
        ("LS+[DG]E", "LDSE", false),
        ("L.*SE", "LSE", true),
        ("L.*SE", "LDGSE", true),
        ("L.*SE", "LSDE", false),
        ("L[^S]*E", "LDGE", true),
        ("L[^S]*E", "LDSE", false),
        ("L(D|SG)?E", "LSGE", true),
        ("L(D|SG)?E", "LE", true),
        ("L(D|SG)?E", "LSE", false),
        ("L.{2,3}E", "LDE", false),
        ("L.{2,3}E", "LDSE", true),
        ("L.{2,3}E", "LDSDE", true),
        ("L.{2,3}E", "LDSDDE", false),
        ("LD{2}E", "LDDE", true),
        ("LD{2,}E", "LDE", false),
        ("LD{2,}E", "LDDDDE", true),
        ("LDE|LSE", "LSE", true),
        ("", "", true),
        ("", "L", false),
        ("L.*E", "LxE", false),
    ] {
        let found = PathAutomaton::compile(pattern).unwrap().accepts(path);
        assert_eq!(found, expected, "{pattern} on {path}");
    }
}

/// All words over the five symbols up to `length`.
fn words(length: usize) -> Vec<String> {
    let mut all = vec![String::new()];
    let mut from = 0;
    for _ in 0..length {
        let to = all.len();
        for at in from..to {
            for symbol in ["L", "D", "G", "S", "E"] {
                all.push(format!("{}{symbol}", all[at]));
            }
        }
        from = to;
    }
    all
}

#[test]
fn every_short_path_is_judged_as_by_another_matcher() {
    let words = words(7);
    for pattern in [
        "L.*E",
        "L[DG]E",
        "LS+[DG]E",
        "L.*SE",
        "LD*(S|GG)+E",
        "(L|LD)(D|DS)*E?",
        "L(DG?){2,3}E",
        "L(S{2,}|D{0,1}){1,2}E",
        "((D|)*|G)*",
        "[^D]{3}|.E{2,}(LD)*",
        ".*D.{2}",
        ".{2}D.*",
        "(((L?D?)+G)*S)?E",
        "D{0}L{0,0}",
        "",
        "|L",
    ] {
        let automaton = PathAutomaton::compile(pattern).unwrap();
        let other = regex::Regex::new(&format!("^(?:{pattern})$")).unwrap();
        for word in &words {
            assert_eq!(
                automaton.accepts(word),
                other.is_match(word),
                "{pattern} on {word}"
            );
        }
    }
}

#[test]
fn automata_are_the_smallest() {
    for (pattern, states) in [
        // Start, after E, after a symbol, accepted, dead.
        ("L.E|L..E|L.{3,}E", 5),
        ("L.*E", 4),
        (".*", 1),
        ("(LD|LG|LS)E", 5),
        ("L.*D.{3}E", 8),
    ] {
        let automaton = PathAutomaton::compile(pattern).unwrap();
        assert_eq!(automaton.transitions.len(), states, "{pattern}");
    }
}

/// Traverses the words as a shader does, from the eye to the light.
#[test]
fn shader_words_hold_the_automaton() {
    let automaton = PathAutomaton::compile("LS+[DG]E").unwrap();
    let words = automaton.words();
    let row = PathAutomaton::WORDS_PER_STATE;
    assert_eq!(words.len(), automaton.transitions.len() * row);
    let walk = |columns: &[usize]| {
        columns
            .iter()
            .fold(0, |state, column| words[state * row + column] as usize)
            * row
            + 6
    };
    let [light, diffuse, glossy, ideal, eye] = [0, 1, 2, 3, 5];
    assert_eq!(words[walk(&[])], 0);
    assert_eq!(words[walk(&[eye, glossy, ideal])], 0);
    assert_eq!(words[walk(&[eye, glossy, ideal, light])], 1);
    assert_eq!(words[walk(&[eye, glossy, ideal, ideal, light])], 1);
    assert_eq!(words[walk(&[eye, diffuse, light])], 2);
    assert_eq!(words[walk(&[eye, ideal])], 2);
    assert_eq!(words[walk(&[light])], 2);
    assert!(!PathFilter::default().automaton().accepts("LD"));
    assert!(PathFilter::default().automaton().accepts("LE"));
}

#[test]
fn a_partition_takes_every_path_once() {
    let whole = PathFilter::default();
    let parts = [
        "LE",
        "L[DG]E",
        "LSE",
        "L.+SE",
        "L.*S[DG]E",
        "L.*[DG]{2}E",
        "L.*VE",
        "L.*V[DG]E",
    ];
    let parts = parts.map(|part| PathAutomaton::compile(part).unwrap());
    for word in words(6) {
        let is_path = word.len() >= 2
            && word.starts_with('L')
            && word.ends_with('E')
            && word[1..word.len() - 1]
                .chars()
                .all(|letter| "DGSV".contains(letter));
        if is_path {
            let count = parts.iter().filter(|part| part.accepts(&word)).count();
            assert_eq!(count, 1, "{word}");
            assert!(whole.automaton().accepts(&word));
        }
    }
}

#[test]
fn what_is_no_pattern_is_refused_with_the_place() {
    for (pattern, place) in [
        ("LXE", 2),
        ("L D", 2),
        ("Lé", 2),
        ("l", 1),
        ("*", 1),
        ("L|+", 3),
        ("(*)", 2),
        ("L(DE", 5),
        ("LD)E", 3),
        ("[", 2),
        ("[]", 2),
        ("[^]", 3),
        ("[D", 3),
        ("[D-G]", 3),
        ("[.]", 2),
        ("[^LDGSVE]", 9),
        ("D**", 3),
        ("D+?", 3),
        ("D{2}{3}", 5),
        ("D{", 3),
        ("D{}", 3),
        ("D{,2}", 3),
        ("D{2", 4),
        ("D{2;3}", 4),
        ("D{3,2}", 6),
        ("D{33}", 3),
        ("D{1,99999999999999999999}", 5),
        ("^L", 1),
        ("L$", 2),
        ("\\d", 1),
    ] {
        match PathAutomaton::compile(pattern) {
            Err(PatternError::Syntax { position, .. }) => {
                assert_eq!(position, place, "{pattern}");
            }
            other => panic!("{pattern}: {other:?}"),
        }
    }
    let message = PathFilter::new("LXE").unwrap_err().to_string();
    assert_eq!(
        message,
        "light path pattern, character 2: found 'X', wanted a symbol (L, D, G, S, V, E), '.', '[' or '('"
    );
}

#[test]
fn hostile_patterns_end_in_errors_soon() {
    let nested = |inner: &str, outer: &str, depth: usize| {
        format!("{}{}", "(".repeat(depth), inner) + &format!("){outer}").repeat(depth)
    };
    let start = std::time::Instant::now();
    for pattern in [
        "D".repeat(257),
        "L".repeat(100_000_000),
        "(".repeat(1_000_000),
    ] {
        let error = PathAutomaton::compile(&pattern).unwrap_err();
        assert!(matches!(error, PatternError::TooLong { .. }), "{error}");
    }
    for pattern in [
        nested("D", "{32}", 40),
        nested("", "{32}", 40),
        nested("D?", "{0,32}", 3),
        // Reading backward must remember the last eleven symbols: 2^11 states.
        ".{10}D.*".to_owned(),
        "(.{2}D|.{9}G).*".to_owned(),
    ] {
        let error = PathAutomaton::compile(&pattern).unwrap_err();
        assert_eq!(error, PatternError::TooComplex, "{pattern}");
    }
    for pattern in [
        nested("D", "", 127),
        nested("", "*", 80),
        "D".repeat(254),
        "(D|".repeat(51) + &")*".repeat(51),
    ] {
        PathAutomaton::compile(&pattern).unwrap_or_else(|error| panic!("{pattern}: {error}"));
    }
    let seconds = start.elapsed().as_secs_f32();
    assert!(seconds < 5.0, "{seconds} s");
}

/// Photons read patterns from the light. A pattern that is complex in this order alone is refused all the same.
#[test]
fn filters_are_compiled_for_both_orders() {
    let filter = PathFilter::new("L.*D.{8}E").unwrap();
    assert!(filter.light_automaton().transitions.len() >= 512);
    let pattern = "L.*D.{10}E";
    assert!(PathAutomaton::compile(pattern).is_ok());
    let error = PathFilter::new(pattern).unwrap_err();
    assert_eq!(error, PatternError::TooComplex);
}

#[test]
fn overlapping_sets_are_found_by_class() {
    let set = |class, pattern| [LightPaths::new(class, pattern)];
    let direct = set(LightClass::Punctual, "L[DG]E");
    assert_eq!(
        overlap(&direct, &set(LightClass::Punctual, "L.E")),
        Some((LightClass::Punctual, "LDE".to_owned()))
    );
    assert_eq!(overlap(&direct, &set(LightClass::Area, "L.E")), None);
    assert_eq!(overlap(&direct, &set(LightClass::Punctual, "LDD+E")), None);
    // Overlaps are found at any length, but only for paths that exist: one light, one eye.
    assert_eq!(
        overlap(
            &set(LightClass::Area, "LD{5,}GE"),
            &set(LightClass::Area, "LD.{5,}E")
        ),
        Some((LightClass::Area, "LDDDDDGE".to_owned()))
    );
    assert_eq!(
        overlap(
            &set(LightClass::Area, "LD*E|LLE"),
            &set(LightClass::Area, "L[LS]+E")
        ),
        None
    );
}

#[test]
fn what_is_left_out_is_named() {
    let left_out = |pattern| {
        let class = LightClass::Area;
        super::left_out(&[LightPaths::new(class, pattern)], &[class], "DGS")
    };
    assert_eq!(
        left_out("L[DG]E"),
        ["LSE (area)", "indirect light, such as LDDE (area)"]
    );
    assert_eq!(
        left_out("L.{1,4}E|LD*E"),
        ["indirect light, such as LGDDDDE (area)"]
    );
    assert!(left_out("L.+E").is_empty());
    assert_eq!(
        super::left_out(&[], &[LightClass::Punctual], "DGS"),
        [
            "LDE, LGE, LSE (punctual)",
            "indirect light, such as LDDE (punctual)"
        ]
    );
    // Where nothing is glossy, no light is missing in gloss.
    let class = LightClass::Area;
    let diffuse = [LightPaths::new(class, "LD+E")];
    let of_lobes = |lobes| super::left_out(&diffuse, &[class], lobes);
    assert!(of_lobes("D").is_empty() && of_lobes("").is_empty());
    assert_eq!(
        of_lobes("DG"),
        ["LGE (area)", "indirect light, such as LGDE (area)"]
    );
    assert_eq!(
        of_lobes("DV"),
        ["LVE (area)", "indirect light, such as LVDE (area)"]
    );
}

#[test]
fn light_paths_are_told_in_words() {
    let (area, sky) = (LightClass::Area, LightClass::Environment);
    let paths = [
        LightPaths::new(area, "L[DG]E"),
        LightPaths::new(sky, "LDE"),
        LightPaths::new(sky, "LS{1,5}DE"),
    ];
    assert_eq!(
        super::in_words(&paths, &[area, sky]),
        [
            "direct light on diffuse surfaces (area, environment)",
            "highlights of lights on glossy surfaces (area)",
            "caustics (environment)",
        ]
    );
    assert_eq!(
        super::in_words(&paths, &[area]),
        [
            "direct light on diffuse surfaces (area)",
            "highlights of lights on glossy surfaces (area)",
        ]
    );
    assert!(super::in_words(&paths, &[LightClass::Punctual]).is_empty());
}

#[test]
fn the_longest_path_is_known_where_there_is_one() {
    for (pattern, most) in [
        ("LE", Some(0)),
        ("L[DG]E", Some(1)),
        ("LE|L[DG]E", Some(1)),
        ("L.{2,3}E", Some(3)),
        ("LD?S?G?E|LDDE", Some(3)),
        ("L.*E", None),
        ("LS+[DG]E", None),
        ("LE|LDD*E", None),
        // Only complete paths count. These patterns contain strings that are not paths, or paths without an end.
        ("LD*", Some(0)),
        ("", Some(0)),
        ("LDE|LE*E|L.L*DE", Some(2)),
        ("LDE|ED*E", Some(1)),
    ] {
        let found = PathAutomaton::compile(pattern).unwrap().most_vertices();
        assert_eq!(found, most, "{pattern}");
    }
}

#[test]
fn the_parts_of_a_picture_are_as_few_as_its_patterns() {
    use LightClass::{Area, Environment, Punctual};
    let paths = |class, pattern| LightPaths::new(class, pattern);
    let part = |classes: &[LightClass], pattern: &str| Part {
        classes: classes.to_vec(),
        pattern: pattern.to_owned(),
    };
    let covered = [paths(Punctual, "L[DG]E"), paths(Area, "L(G|D)E")];
    assert_eq!(
        parts(&covered, &LightClass::ALL),
        [
            part(&[Punctual, Area], "LE|L[DG]E"),
            part(&[Environment], "LE")
        ]
    );
    assert_eq!(parts(&covered, &[Area]), [part(&[Area], "LE|L(G|D)E")]);
    let more = [
        paths(Environment, "L[DG]E"),
        paths(Environment, "LSE"),
        paths(Area, "L[DGS]E"),
    ];
    assert_eq!(
        parts(&more, &[Area, Environment]),
        [part(&[Area, Environment], "LE|L[DGS]E")]
    );
    assert_eq!(parts(&more, &[]), []);
}

#[test]
fn every_technique_declares_patterns() {
    for info in Registry::default()
        .all()
        .iter()
        .map(|registration| registration.info)
    {
        for paths in info.paths {
            let compiled = PathAutomaton::compile(&paths.pattern);
            assert!(compiled.is_ok(), "{}: {compiled:?}", info.name);
        }
    }
}

/// Two halves of a path make up the path, wherever it is cut.
#[test]
fn halves_make_up_paths() {
    let words: Vec<String> = (0..4096_usize)
        .map(|number| (0..4).map(move |place| char::from(b"LDGSVE\0\0"[number >> (3 * place) & 7])))
        .map(|letters| letters.filter(|&letter| letter != '\0').collect())
        .collect();
    for pattern in ["L.*E", "LS+[DG]E", "LS.*D.*SE|LDE", "L(SD)*GE", "LE"] {
        let filter = PathFilter::new(pattern).unwrap();
        let (light, eye, joint) = (filter.light_automaton(), filter.automaton(), filter.joint());
        let read = |automaton: &PathAutomaton, letters: &mut dyn Iterator<Item = char>| {
            letters.fold(0, |state, letter| {
                let symbol = "LDGSVE".find(letter).unwrap();
                automaton.transitions[state][symbol] as usize
            })
        };
        for word in words.iter().step_by(3) {
            for cut in 0..=word.len() {
                let of_light = read(light, &mut word[..cut].chars());
                let of_eye = read(eye, &mut word[cut..].chars().rev());
                let found = joint[of_light * eye.transitions.len() + of_eye];
                assert_eq!(found, eye.accepts(word), "{pattern}: {word}, cut at {cut}");
            }
        }
    }
}
