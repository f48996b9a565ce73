// The page for people: live picture, what is covered, what to do next, and a webcam if there is one.
'use strict';

const $ = id => document.getElementById(id);
let live = -1;

const post = (path, body) => fetch(path, { method: 'POST', body: JSON.stringify(body) });
const command = (what, name = '') => post('command', { do: what, name });

$('take').onclick = () => command('take');
$('finish').onclick = () => command('finish');
$('stop').onclick = () => command('stop');
$('scene').onsubmit = event => {
    event.preventDefault();
    command('scene', $('name').value);
};
addEventListener('keydown', event => {
    if (event.code === 'Space' && event.target === document.body && !$('take').disabled) {
        event.preventDefault();
        command('take');
    }
});

function list(element, lines) {
    element.replaceChildren(...lines.map(line => {
        const item = document.createElement('li');
        item.textContent = line;
        return item;
    }));
}

function drawCorners(corners, [width, height]) {
    const canvas = $('corners');
    if (canvas.width !== width || canvas.height !== height) {
        canvas.width = width;
        canvas.height = height;
    }
    const context = canvas.getContext('2d');
    context.clearRect(0, 0, width, height);
    context.strokeStyle = '#2ecc71';
    context.lineWidth = Math.max(1, width / 400);
    for (const [x, y] of corners) {
        context.beginPath();
        context.arc(x + .5, y + .5, width / 120, 0, 7);
        context.stroke();
    }
}

function drawCoverage(coverage) {
    const [columns] = coverage.grid;
    $('cells').style.gridTemplateColumns = `repeat(${columns}, 1fr)`;
    $('cells').replaceChildren(...coverage.cells.map(n => {
        const cell = document.createElement('div');
        if (n) cell.style.background = `rgb(39 174 96 / ${Math.min(1, .25 + n / 12)})`;
        cell.title = `${n} positions`;
        return cell;
    }));
    const depths = coverage.depths_mm, low = Math.min(...depths), high = Math.max(...depths);
    $('depths').hidden = depths.length < 2;
    $('depths').replaceChildren(...depths.map(z => {
        const mark = document.createElement('i');
        mark.style.left = `${100 * (z - low) / Math.max(high - low, 1)}%`;
        return mark;
    }));
    const range = depths.length ? `, ${low.toFixed(0)} to ${high.toFixed(0)} mm` : '';
    $('covered').textContent = `${coverage.positions} of ${coverage.wanted} positions${range}`;
}

async function update() {
    try {
        const { status, screen, webcam, frames } = await (await fetch('status')).json();
        $('stage').textContent = status.stage;
        $('message').textContent = status.message;
        $('problem').textContent = status.problem;
        $('board').textContent = status.board;
        $('exposure').textContent = status.exposure_text;
        $('timing').textContent = status.timing;
        $('field').textContent = status.field;
        $('locks').textContent = webcam + (frames ? ` ${frames} frames sent.` : '');
        $('take').disabled = status.stage !== 'sweep';
        $('finish').disabled = status.stage !== 'sweep';
        $('scene').hidden = status.stage !== 'scenes';
        list($('warnings'), screen ? screen.warnings : ['The window for the patterns is not open.']);
        list($('scenes'), status.scenes.map(name => 'scene ' + name));
        if (status.coverage.cells.length) drawCoverage(status.coverage);
        if (status.live !== live) {
            live = status.live;
            $('live').src = 'live.png?' + live;
            drawCorners(status.corners_px, status.live_size);
        }
        document.body.dataset.ready = 'yes';
    } catch {
        $('stage').textContent = 'the program has ended';
    }
    setTimeout(update, 300);
}

// ---- The webcam ----

async function lock(track) {
    const can = track.getCapabilities ? track.getCapabilities() : {};
    const locked = [], open = [];
    for (const [mode, word] of [['exposureMode', 'exposure'], ['whiteBalanceMode', 'white balance'], ['focusMode', 'focus']]) {
        if ((can[mode] || []).includes('manual')) {
            try {
                await track.applyConstraints({ advanced: [{ [mode]: 'manual' }] });
                locked.push(word);
                continue;
            } catch { /* named below */ }
        }
        open.push(word);
    }
    const words = [];
    if (locked.length) words.push(`Locked: ${locked.join(', ')}.`);
    if (open.length) {
        words.push(`This browser cannot lock ${open.join(', ')}: lock it in the camera's own program ` +
            '(guvcview, v4l2-ctl). Whether exposure is locked is checked before anything is captured.');
    }
    return words.join(' ');
}

async function useWebcam(id) {
    const size = { width: { ideal: 1280 }, height: { ideal: 720 } };
    const stream = await navigator.mediaDevices.getUserMedia({ video: id ? { ...size, deviceId: { exact: id } } : size });
    const [track] = stream.getVideoTracks();
    await post('webcam', `${track.label}. ${await lock(track)}`);
    const video = document.createElement('video');
    video.srcObject = stream;
    video.muted = true;
    await video.play();
    const canvas = document.createElement('canvas');
    const context = canvas.getContext('2d', { willReadFrequently: true, alpha: false, colorSpace: 'srgb' });
    const shown = () => new Promise(resolve => video.requestVideoFrameCallback
        ? video.requestVideoFrameCallback(resolve) : requestAnimationFrame(resolve));
    for (;;) {
        await shown();
        canvas.width = video.videoWidth;
        canvas.height = video.videoHeight;
        context.drawImage(video, 0, 0);
        const pixels = context.getImageData(0, 0, canvas.width, canvas.height);
        // One at a time: the next frame waits for the answer, so nothing piles up.
        await fetch(`frame?width=${pixels.width}&height=${pixels.height}`, { method: 'POST', body: pixels.data });
    }
}

$('webcam').onclick = async () => {
    try {
        useWebcam($('cameras').value).catch(error => { $('locks').textContent = `The webcam stopped: ${error.message}`; });
        const devices = (await navigator.mediaDevices.enumerateDevices()).filter(d => d.kind === 'videoinput');
        $('cameras').replaceChildren(...devices.map(d => new Option(d.label || d.deviceId, d.deviceId)));
        $('cameras').hidden = devices.length < 2;
    } catch (error) {
        $('locks').textContent = `No webcam: ${error.message}`;
    }
};
if (location.hash === '#webcam') $('webcam').click();
update();
