// Shows slides one to one in device pixels and says when each has been on the screen for two refreshes.
//
// With `#mirror` it sends its own pixels, read back from the canvas, as if it were the webcam: the whole path without
// hardware, and a proof that what is drawn is what the files hold.
'use strict';

const canvas = document.getElementById('canvas');
const context = canvas.getContext('2d', { alpha: false, colorSpace: 'srgb', willReadFrequently: location.hash === '#mirror' });
const images = new Map();
let refresh = 1000 / 60;
let missed = 0;
let latest = null;

const frame = () => new Promise(resolve => requestAnimationFrame(resolve));

async function image(name) {
    if (!images.has(name)) {
        const reply = await fetch('slide/' + name);
        if (!reply.ok) throw new Error('no slide ' + name);
        const exact = { colorSpaceConversion: 'none', premultiplyAlpha: 'none' };
        images.set(name, await createImageBitmap(await reply.blob(), exact));
    }
    return images.get(name);
}

function fit([width, height]) {
    if (canvas.width !== width || canvas.height !== height) {
        canvas.width = width;
        canvas.height = height;
    }
    canvas.style.width = width / devicePixelRatio + 'px';
    canvas.style.height = height / devicePixelRatio + 'px';
}

function warnings([width, height]) {
    const found = [];
    const w = Math.round(innerWidth * devicePixelRatio), h = Math.round(innerHeight * devicePixelRatio);
    if (w !== width || h !== height) {
        found.push(`The window has ${w} x ${h} device pixels, the patterns ${width} x ${height}: click into it to fill ` +
            'the screen, and set the projector to the size of the patterns.');
    }
    if (!Number.isInteger(devicePixelRatio)) {
        found.push(`The screen is scaled by ${devicePixelRatio}: set its scaling to 100 % and the page's zoom to 100 %.`);
    }
    if (matchMedia('(color-gamut: p3)').matches) {
        found.push('The screen is color managed (wide gamut): codes may be converted; choose sRGB or no profile for it.');
    }
    if (missed > 3) found.push(`${missed} refreshes came late: close other programs that draw.`);
    if (document.hidden) found.push('The window is hidden: bring it to the front.');
    return found;
}

async function measureRefresh() {
    let last = await frame();
    const gaps = [];
    for (let i = 0; i < 30; i++) {
        const now = await frame();
        gaps.push(now - last);
        last = now;
    }
    gaps.sort((a, b) => a - b);
    refresh = gaps[15] || refresh;
}

async function show(next) {
    const bitmap = await image(next.slide);
    fit(next.size);
    context.imageSmoothingEnabled = false;
    // The file's own pixels; a slide of another size would be a mistake, and is said.
    context.drawImage(bitmap, 0, 0);
    const first = await frame();
    const second = await frame();
    if (second - first > 1.5 * refresh) missed++;
    const told = warnings(next.size);
    if (bitmap.width !== next.size[0] || bitmap.height !== next.size[1]) {
        told.push(`The slide ${next.slide} has ${bitmap.width} x ${bitmap.height} px, not ${next.size.join(' x ')}.`);
    }
    latest = next;
    const body = { sequence: next.sequence, width: canvas.width, height: canvas.height, missed, warnings: told };
    await fetch('shown', { method: 'POST', body: JSON.stringify(body) });
}

async function mirror() {
    for (;;) {
        await frame();
        if (!latest) continue;
        const pixels = context.getImageData(0, 0, canvas.width, canvas.height);
        const query = `frame?width=${pixels.width}&height=${pixels.height}`;
        await fetch(query, { method: 'POST', body: pixels.data }).catch(() => null);
    }
}

async function run() {
    await measureRefresh();
    if (location.hash === '#mirror') mirror();
    let sequence = 0;
    for (;;) {
        try {
            const reply = await fetch('next?after=' + sequence);
            if (!reply.ok) throw new Error('the program refused');
            const next = await reply.json();
            if (next.ended) break;
            if (next.slide && next.sequence > sequence) {
                document.body.classList.add('running');
                await show(next);
                sequence = next.sequence;
                // The others are there when they are needed: no slide waits for its file.
                if (next.sequence === 1) for (let i = 0; i < next.patterns; i++) await image(String(i));
            }
        } catch {
            await new Promise(resolve => setTimeout(resolve, 500));
        }
    }
    document.body.classList.remove('running');
    document.getElementById('hint').textContent = 'The capture has ended; this window may be closed.';
}

addEventListener('click', () => document.documentElement.requestFullscreen({ navigationUI: 'hide' }).catch(() => null));
run();
