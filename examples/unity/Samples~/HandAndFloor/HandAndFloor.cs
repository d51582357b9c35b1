using Tensionlab;
using UnityEngine;

/// <summary>
/// A hand that follows the mouse, a floor that it feels, and the force that the cables exert. Start
/// `tensionlab serve bartels2026-validation`, then play.
/// </summary>
public class HandAndFloor : MonoBehaviour
{
    [Tooltip("Where the hand begins, in m; the home of the rig.")]
    public Vector3 home = new Vector3(0f, 0.3f, 0f);
    [Tooltip("Edge of the square in which the mouse moves the hand, in m.")]
    public float span = 0.4f;

    TensionlabBridge bridge;
    Transform hand, arrow;

    void Awake()
    {
        hand = Shape("Hand", PrimitiveType.Sphere, home, 0.02f * Vector3.one);
        arrow = Shape("Force", PrimitiveType.Cube, home, Vector3.zero);
        Transform floor = Shape("Floor", PrimitiveType.Cube, home + 0.025f * Vector3.down, new Vector3(0.4f, 0.01f, 0.4f));
        bridge = gameObject.AddComponent<TensionlabBridge>();
        bridge.hand = hand;
        WallEffect wall = floor.gameObject.AddComponent<WallEffect>();
        wall.stiffness = 100f;
        if (Camera.main == null) new GameObject("Camera").AddComponent<Camera>();
        Camera view = Camera.main != null ? Camera.main : FindObjectOfType<Camera>();
        view.transform.position = home + new Vector3(0f, 0.1f, -0.6f);
    }

    void Update()
    {
        float x = Input.mousePosition.x / Screen.width - 0.5f, y = Input.mousePosition.y / Screen.height - 0.5f;
        hand.position = home + span * new Vector3(Mathf.Clamp(x, -0.5f, 0.5f), Mathf.Clamp(y, -0.5f, 0.5f), 0f);
        Vector3 force = 0.05f * bridge.MeasuredForce;  // m a N
        arrow.position = hand.position + 0.5f * force;
        arrow.localScale = new Vector3(0.004f, 0.004f, force.magnitude);
        if (force.magnitude > 0f) arrow.rotation = Quaternion.LookRotation(force);
    }

    void OnGUI()
    {
        string said = bridge.State == null ? "no bridge" : "force of the cables: " + bridge.MeasuredForce.ToString("F2") + " N";
        GUI.Label(new Rect(10f, 10f, 400f, 20f), said);
    }

    static Transform Shape(string name, PrimitiveType type, Vector3 place, Vector3 size)
    {
        Transform shape = GameObject.CreatePrimitive(type).transform;
        shape.name = name;
        shape.position = place;
        shape.localScale = size;
        return shape;
    }
}
