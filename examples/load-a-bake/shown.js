/// Shows the file that the page's address names (`?file=baked.glb`) by `draw`, which gets it and the size of the picture and
/// returns the canvas. With `post=WIDTHxHEIGHT`, posts the picture to the server, as PNG, for tests.
export async function shown(draw) {
    const asked = new URLSearchParams(location.search);
    const post = asked.get('post');
    try {
        const size = post ? post.split('x').map(Number) : [innerWidth, innerHeight];
        const canvas = await draw(asked.get('file') ?? 'baked.glb', size);
        if (post) {
            const picture = await new Promise((done) => canvas.toBlob(done));
            await fetch('/picture', { method: 'POST', body: picture });
        }
    } catch (error) {
        document.body.append(String(error));
        if (post) {
            await fetch('/error', { method: 'POST', body: String(error?.stack ?? error) });
        }
    }
}
