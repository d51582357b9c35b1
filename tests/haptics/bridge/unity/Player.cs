// Plays a scene as Unity would, 90 pictures a second, by lines on its standard input; prints what happens.
//
//   on NAME KIND x y z [FIELD VALUE ...]   add an effect's component at a place, and enable it
//   turn NAME x y z degrees                turn an object
//   off NAME                               disable it
//   hand x y z                             move the hand
//   shoot NAME / release NAME              call the method of an effect
//   axes UP DIMENSION x y z qx qy qz qw    print a vector, an orientation and the turned vector in a rig's axes
//   state                                  print the next state
//   stop                                   end the run
using System;
using System.Collections.Concurrent;
using System.Collections.Generic;
using System.Globalization;
using System.Linq;
using System.Reflection;
using System.Threading;
using Tensionlab;
using UnityEngine;

public static class Player
{
    static readonly Dictionary<string, HapticEffect> Effects = new Dictionary<string, HapticEffect>();
    static readonly BlockingCollection<string> Lines = new BlockingCollection<string>();
    static TensionlabBridge bridge;
    static Transform hand;
    static int wanted;

    public static void Main(string[] words)
    {
        hand = new GameObject("Hand").transform;
        bridge = new GameObject("Rig").AddComponent<TensionlabBridge>();
        bridge.url = words[0];
        bridge.retry = 0.1f;
        bridge.hand = hand;
        if (words.Length > 1) bridge.transform.position = Vector(words, 1);
        hand.position = bridge.transform.position + new Vector3(0f, 0.3f, 0f);
        bridge.Connected += each => Say("connected: {0}, {1} modules, up {2}", each.Rig, each.Modules.Length, each.Up);
        bridge.ConnectionLost += reason => Say("lost");
        bridge.FrameRefused += reason => Say("refused: {0}", reason);
        bridge.Happened += each => Say("event: {0}: {1}", each.Kind, each.Words);
        bridge.StateReceived += Show;
        new Thread(Read) { IsBackground = true }.Start();
        Call(bridge, "OnEnable");
        for (bool open = true; open; Thread.Sleep(11))
        {
            string line;
            while (open && Lines.TryTake(out line)) open = Do(line.Split(' '));
            Call(bridge, "Update");
        }
        Call(bridge, "OnDisable");
        Say("closed");
    }

    static void Read()
    {
        for (string line = Console.ReadLine(); line != null; line = Console.ReadLine()) Lines.Add(line);
        Lines.Add("quit");
    }

    static bool Do(string[] words)
    {
        switch (words[0])
        {
            case "on": TurnOn(words); break;
            case "turn": Object(words[1]).rotation = Quaternion.AngleAxis(Number(words[5]), Vector(words, 2)); break;
            case "off": Call(Effects[words[1]], "OnDisable"); break;
            case "hand": hand.position = Vector(words, 1); break;
            case "shoot": ((RecoilEffect)Effects[words[1]]).Shoot(); break;
            case "release": ((BowEffect)Effects[words[1]]).Release(); break;
            case "axes": ShowAxes(new RigAxes(words[1], int.Parse(words[2])), words); break;
            case "state": wanted = 2; break;
            case "stop": bridge.Stop(); break;
            case "quit": return false;
            default: throw new ArgumentException(words[0]);
        }
        return true;
    }

    static void ShowAxes(RigAxes axes, string[] words)
    {
        Vector3 vector = Vector(words, 3), back = axes.ToUnity(axes.FromUnity(vector));
        Vector3 imaginary = Vector(words, 6);
        var turn = new Quaternion(imaginary.x, imaginary.y, imaginary.z, Number(words[9]));
        Say("axes: {0}", Json.Write(new object[] {
            axes.FromUnity(vector), axes.Dimension == 3 ? axes.FromUnity(turn) : null, axes.FromUnity(turn * vector), new[] { back.x, back.y, back.z }
        }));
    }

    static Transform Object(string name)
    {
        return name == "Rig" ? bridge.transform : Effects[name].transform;
    }

    static void TurnOn(string[] words)
    {
        Type type = typeof(HapticEffect).Assembly.GetType("Tensionlab." + words[2] + "Effect", true);
        var thing = new GameObject(words[1]);
        MethodInfo add = typeof(GameObject).GetMethod("AddComponent").MakeGenericMethod(type);
        var effect = (HapticEffect)add.Invoke(thing, null);
        thing.transform.position = Vector(words, 3);
        for (int i = 6; i < words.Length; i += 2)
        {
            FieldInfo field = type.GetField(words[i]);
            if (field.FieldType.IsEnum) field.SetValue(effect, Enum.Parse(field.FieldType, words[i + 1]));
            else field.SetValue(effect, Number(words[i + 1]));
        }
        Effects[words[1]] = effect;
        Call(effect, "OnEnable");
    }

    // The first state after a command may be of a frame before it.
    static void Show(State state)
    {
        if (wanted == 0 || --wanted > 0) return;
        Say("state: desired {0} measured {1}", bridge.DesiredForce.ToString("F3"), bridge.MeasuredForce.ToString("F3"));
    }

    static void Call(Component on, string method)
    {
        for (Type type = on.GetType(); type != null; type = type.BaseType)
        {
            BindingFlags every = BindingFlags.Instance | BindingFlags.Public | BindingFlags.NonPublic | BindingFlags.DeclaredOnly;
            MethodInfo found = type.GetMethod(method, every);
            if (found == null) continue;
            found.Invoke(on, null);
            return;
        }
    }

    static Vector3 Vector(string[] words, int at)
    {
        float[] numbers = words.Skip(at).Take(3).Select(Number).ToArray();
        return new Vector3(numbers[0], numbers[1], numbers[2]);
    }

    static float Number(string word)
    {
        return float.Parse(word, CultureInfo.InvariantCulture);
    }

    static void Say(string format, params object[] what)
    {
        Console.WriteLine(string.Format(CultureInfo.InvariantCulture, format, what));
        Console.Out.Flush();
    }
}
